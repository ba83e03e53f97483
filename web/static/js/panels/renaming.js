// Renaming the fold of the page, by its owner.
import { tokenOf } from "../lib/keys.js";
import { asked } from "../lib/made.js";
import { element, get, wordsOf } from "../lib/text.js";

const LONGEST_NAME = 200;

export class Renaming {
  /**
   * @param {Facts} facts
   * @param {{ toast: (text: string) => void, onNamed: (name: string) => void }} around
   */
  constructor(facts, { toast, onNamed }) {
    this.facts = facts;
    this.toast = toast;
    this.onNamed = onNamed;
    this.token = tokenOf(facts.id);
    get("rename").hidden = !this.token;
    get("rename").onclick = () => this.ask();
  }

  ask() {
    get("ways-list").hidePopover();
    const heading = get("name");
    const input = element("input", { type: "text", maxlength: LONGEST_NAME, value: heading.textContent, "aria-label": "New name", required: true, autocomplete: "off" });
    const form = element("form", { class: "renaming" }, input, element("button", { class: "button primary", type: "submit" }, "Save"));
    const back = () => {
      form.remove();
      heading.hidden = false;
      get("ways").focus();
    };
    input.onkeydown = (event) => {
      event.stopPropagation(); // the player's keys are letters
      if (event.key === "Escape") back();
    };
    form.onsubmit = async (event) => {
      event.preventDefault();
      try {
        const { title } = await asked("PATCH", `/api/folds/${this.facts.id}`, this.token, { name: input.value });
        this.onNamed(title);
        back();
      } catch (error) {
        this.toast(wordsOf(error));
        input.focus();
      }
    };
    heading.hidden = true;
    heading.after(form);
    input.select();
  }
}
