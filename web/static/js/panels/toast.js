// A line that comes and goes.
import { get } from "../lib/text.js";

const SHOWN_MS = 2600;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;

/** @param {string} text */
export function toast(text) {
  const line = get("toast");
  line.textContent = text;
  line.hidden = false;
  clearTimeout(timer);
  timer = setTimeout(() => { line.hidden = true; }, SHOWN_MS);
}
