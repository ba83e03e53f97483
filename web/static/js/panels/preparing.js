// How far the solvers are compiled, which happens once on a machine: words and a bar.
import { get, remaining } from "../lib/text.js";

/** @param {Preparing} preparing */
export function preparingWords({ fraction, remaining_s: left }) {
  const percent = Math.floor(100 * fraction);
  if (!percent) return "Starting the solvers…"; // it is not known yet whether any are to be compiled
  const words = `First start: preparing the solvers, ${percent} % done. This happens only once`;
  return left ? `${words} · ${remaining(left)}` : words;
}

// Shows it, or hides what shows it once that is over.
/** @param {Preparing | null} preparing */
export function showPreparing(preparing) {
  const place = get("preparing");
  place.hidden = !preparing;
  if (!preparing) return;
  const [text, bar] = place.children;
  text.textContent = preparingWords(preparing);
  bar.setAttribute("aria-valuenow", String(Math.floor(100 * preparing.fraction)));
  /** @type {HTMLElement} */ (bar.firstElementChild).style.width = `${100 * preparing.fraction}%`;
}
