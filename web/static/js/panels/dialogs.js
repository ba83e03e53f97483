// Dialogs: a question before something that cannot be undone, and one for a new name.
import { element, get, wordsOf } from "../lib/text.js";
import { toast } from "./toast.js";

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

const MAX_NAME_CHARACTERS = 200;

// Show a field for a new name in place of a heading. Return what closes it.
/**
 * @param {HTMLElement} heading
 * @param {string} name
 * @param {{ save: (name: string) => Promise<void>, back: () => void }} done
 */
export function renameForm(heading, name, { save, back }) {
  const input = element("input", { type: "text", maxlength: MAX_NAME_CHARACTERS, value: name, "aria-label": "New name", required: true, autocomplete: "off" });
  const form = element("form", { class: "renaming" }, input, element("button", { class: "button primary", type: "submit" }, "Save"));
  const close = () => {
    form.remove();
    heading.hidden = false;
    back();
  };
  input.onkeydown = (event) => {
    event.stopPropagation(); // the player's keys are letters
    if (event.key === "Escape") close();
  };
  form.onsubmit = async (event) => {
    event.preventDefault();
    try {
      await save(input.value);
      close();
    } catch (error) {
      toast(wordsOf(error));
      input.focus();
    }
  };
  heading.hidden = true;
  heading.after(form);
  input.select();
  return close;
}
