// Progress of compiling the kernels, which happens once per machine: text and a bar.
import { askUntil } from "../lib/api.js";
import { duration, get } from "../lib/text.js";

const FEW_S = 5;
const ASK_MS = 1000;

// Return the remaining time, as estimated by the service, as text.
/**
 * @param {number} value in seconds; 0 if it takes longer than usual
 * @param {boolean} busy true if the computer has other work
 */
export function remaining(value, busy = false) {
  if (value <= 0)
    return busy ? "slow, because the computer is busy with other work" : "takes longer than usual";
  return value < FEW_S
    ? "a few seconds left"
    : `${duration(value < 20 ? value : 5 * Math.round(value / 5))} left`;
}

/** @param {Api.CompilationBody} compilation */
export function compilationWords({ fraction, remaining_s: remainingS }) {
  const percent = Math.floor(100 * fraction);
  // It is unknown yet whether any kernel must be compiled.
  if (!percent) return "Starting the folding software…";
  const words =
    `First start: compiling the folding software, ${percent} % done. ` + "This happens only once";
  return remainingS ? `${words} · ${remaining(remainingS)}` : words;
}

// Show the progress, or hide the bar once it is over.
/** @param {Api.CompilationBody | null} compilation */
export function showCompilation(compilation) {
  const place = get("compilation");
  place.hidden = !compilation;
  if (!compilation) return;
  const [text, bar] = place.children;
  text.textContent = compilationWords(compilation);
  bar.setAttribute("aria-valuenow", String(Math.floor(100 * compilation.fraction)));
  /** @type {HTMLElement} */ (bar.firstElementChild).style.width = `${100 * compilation.fraction}%`;
}

// Update the progress until it is over, on a page that was loaded with it.
/** @param {(compilation: Api.CompilationBody | null) => void} tell */
export function followCompilation(tell = () => {}) {
  return askUntil(
    "/api/compilation",
    ASK_MS,
    (/** @type {Api.CompilationState} */ { compilation }) => {
      showCompilation(compilation);
      tell(compilation);
      return !compilation;
    },
  );
}
