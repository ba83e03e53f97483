// The verdict of a fold's figure at full size, which the first page that asks has to wait for.
import { ask } from "../lib/api.js";
import { get } from "../lib/text.js";

// Show the verdict, the proof if single turns do not lead to the figure, and the largest size on
// the card of a failed fold.
/**
 * @param {string} id
 * @param {FullSize} stored
 */
export async function showFullSize(id, stored) {
  const value = get("full-size");
  const label = /** @type {HTMLElement} */ (value.previousElementSibling);
  /** @param {string} text */
  const say = (text) => {
    value.textContent = text;
    label.hidden = value.hidden = !text;
  };
  if (!stored.text) say("Looking for turns…");
  /** @type {FullSize | null} */
  const verdict = stored.text ? stored : await ask(`/folds/${id}/verdict.json`).catch(() => null);
  say(verdict?.text ?? "");
  get("exhaustion").hidden = !verdict?.has_proof;
  if (verdict?.hint && get("stuck-size")) {
    get("stuck-size").textContent = verdict.hint;
    get("stuck-size").hidden = false;
  }
}
