// Renaming of a fold by its owner.
import { ask, tokenOf } from "../lib/api.js";
import { get } from "../lib/text.js";
import { renameForm } from "./dialogs.js";

// Offer the owner of the page's fold to rename it.
/**
 * @param {string} id
 * @param {(name: string) => void} onNamed
 */
export function offerRenaming(id, onNamed) {
  const token = tokenOf(id);
  get("rename").hidden = !token;
  get("rename").onclick = () => {
    get("ways-list").hidePopover();
    renameForm(get("name"), get("name").textContent, {
      back: () => get("ways").focus(),
      save: async (name) => {
        /** @type {Api.Fold} */
        const { title } = await ask(`/api/folds/${id}`, { method: "PATCH", token, body: { name } });
        onNamed(title);
      },
    });
  };
}
