// Dialogs: confirmation of an action that cannot be undone, and a new name.
import { get, toast, wordsOf } from "../lib/text.js";

// Open a dialog. Return true if it is closed with its button "yes".
/**
 * @param {HTMLDialogElement} dialog
 * @returns {Promise<boolean>}
 */
function answered(dialog) {
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((answer) => {
    dialog.addEventListener("close", () => answer(dialog.returnValue === "yes"), { once: true });
  });
}

/**
 * @param {string} heading
 * @param {string} text
 * @param {string} action label of the button that confirms
 * @param {boolean} danger whether the action destroys something
 */
export function confirmed(heading, text, action, danger = false) {
  get("confirm-heading").textContent = heading;
  get("confirm-text").textContent = text;
  get("confirm-yes").textContent = action;
  get("confirm-yes").classList.toggle("danger", danger);
  return answered(get("confirm"));
}

// Ask for another name and save it. Return true if it was saved.
/**
 * @param {string} name
 * @param {(name: string) => Promise<void>} save
 */
export async function renamed(name, save) {
  const field = get("new-name");
  field.value = name;
  const answer = answered(get("renaming"));
  field.select();
  if (!(await answer) || field.value === name) return false;
  try {
    await save(field.value);
    return true;
  } catch (error) {
    toast(wordsOf(error));
    return false;
  }
}
