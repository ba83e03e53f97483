// A line that comes and goes.
const SHOWN_MS = 2600;
let timer;

export function toast(text) {
  const line = document.getElementById("toast");
  line.textContent = text;
  line.hidden = false;
  clearTimeout(timer);
  timer = setTimeout(() => { line.hidden = true; }, SHOWN_MS);
}
