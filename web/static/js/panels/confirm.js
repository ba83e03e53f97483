// A question before something that cannot be undone.
import { get } from "../lib/text.js";

/**
 * @param {string} heading
 * @param {string} text
 * @param {string} action what the button says that does it
 * @returns {Promise<boolean>}
 */
export function confirmed(heading, text, action) {
  const dialog = get("confirm");
  get("confirm-heading").textContent = heading;
  get("confirm-text").textContent = text;
  get("confirm-yes").textContent = action;
  dialog.returnValue = "";
  dialog.showModal();
  get("confirm-no").focus();
  return new Promise((answered) => {
    dialog.addEventListener("close", () => answered(dialog.returnValue === "yes"), { once: true });
  });
}
