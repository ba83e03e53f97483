// Renaming of a fold by its owner.
import { ask, tokenOf } from "../lib/api.js";
import { get } from "../lib/text.js";
import { renamed } from "./dialogs.js";

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
    renamed(get("name").textContent, async (name) => {
      /** @type {Api.Fold} */
      const { title } = await ask(`/api/folds/${id}`, { method: "PATCH", token, body: { name } });
      onNamed(title);
    });
  };
}
