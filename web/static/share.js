// Sharing: a link to what is seen now, a frame for other pages, one file that plays by itself.
import { file } from "./take_away.js";
import { copyText } from "./words.js";

const get = (id) => document.getElementById(id);

export class Share {
  constructor(facts, place, toast) {
    this.place = place;
    this.toast = toast;
    this.dialog = get("sharing");
    get("share").onclick = () => this.open();
    get("share-here").onchange = () => this.fill();
    for (const button of this.dialog.querySelectorAll("[data-copy]")) {
      button.onclick = () => this.copy(get(button.dataset.copy));
    }
    this.embed = facts.embed;
  }

  // What there is without a server, once there is something.
  facts({ files }) {
    get("share-files").hidden = !files.length;
    get("share-list").replaceChildren(...files.map(file));
  }

  open() {
    this.fill();
    this.dialog.showModal();
    get("share-link").select();
  }

  fill() {
    const here = this.place.here();
    const path = get("share-here").checked ? here : location.pathname;
    get("share-link").value = location.origin + path;
    if (!this.embed) return;
    const hash = path.includes("#") ? path.slice(path.indexOf("#")) : "";
    get("share-embed").value = `<iframe src="${location.origin}${this.embed}${hash}" title="${document.title.replaceAll('"', "")}" width="720" height="480" style="border:0" allow="fullscreen" loading="lazy"></iframe>`;
  }

  copy(field) {
    copyText(field.value, () => this.toast("Copied"), () => field.select());
  }
}
