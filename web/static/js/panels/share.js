// Sharing: a link to what is seen now, a frame for other pages, one file that plays by itself.
import { file } from "./downloads.js";
import { Picture } from "./picture.js";
import { tokenOf } from "../lib/api.js";
import { at, copyText, element, get } from "../lib/text.js";

export class Share {
  /**
   * @param {Facts} facts
   * @param {{ place: import("../player/address.js").Place, player: import("../player/player.js").Player }} view
   * @param {(text: string) => void} toast
   */
  constructor(facts, { place, player }, toast) {
    new Picture(player, toast);
    this.place = place;
    this.toast = toast;
    this.dialog = get("sharing");
    get("share-here").onchange = () => this.fill();
    for (const name of /** @type {const} */ (["share-link", "share-embed"])) {
      const button = /** @type {HTMLElement | null} */ (this.dialog.querySelector(`[data-copy=${name}]`));
      if (button) button.onclick = () => this.copy(get(name));
    }
    // The system's own way to send a link, where there is one.
    get("share-send").hidden = !("share" in navigator);
    get("share-send").onclick = () => navigator.share({ title: document.title, url: get("share-link").value }).catch(() => {}); // closed again
    get("share-mine").hidden = !tokenOf(facts.id);
    this.embed = facts.embed;
    const lead = document.getElementById("lead"); // not without a service
    if (lead) lead.onclick = async () => { this.dialog.close(); (await import("../tour/leader.js")).lead(facts.id, { place, toast }); };
    get("share-files").append(element("p", { class: "hint" }, "To show the HTML file in a page of your own, put ",
      element("a", { href: "/static/foldback-fold.js", download: true }, "foldback-fold.js"), " beside it and write ", element("code", {}, '<foldback-fold src="FILE.html"></foldback-fold>'), "."));
  }

  // With what there is without a server, once there is something.
  /** @param {Facts} facts */
  open({ files }) {
    get("share-files").hidden = !files.length;
    get("share-list").replaceChildren(...files.map(file));
    this.fill();
    this.dialog.showModal();
    get("share-link").select();
  }

  fill() {
    const path = get("share-here").checked ? this.place.shared() : location.pathname;
    get("share-link").value = location.origin + path;
    if (!this.embed) return;
    const hash = path.includes("#") ? path.slice(path.indexOf("#")) : "";
    get("share-embed").value = `<iframe src="${location.origin}${at(this.embed)}${hash}" title="${get("name").textContent.replaceAll('"', "&quot;")}" width="720" height="480" style="border:0" allow="fullscreen" loading="lazy"></iframe>`;
  }

  /** @param {HTMLInputElement | HTMLTextAreaElement} field */
  copy(field) {
    copyText(field.value, () => this.toast("Copied"), () => field.select());
  }
}
