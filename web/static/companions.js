// Where one goes from a fold: beside another one, or on into another shape.
import { foldAsked } from "./asking.js";
import { element } from "./words.js";

const get = (id) => document.getElementById(id);

export class Companions {
  constructor(toast) {
    this.toast = toast;
    for (const name of ["compare", "refold"]) get(name).onclick = () => { this.fill(name); get(`${name}-dialog`).showModal(); };
  }

  facts(facts) {
    this.id = facts.id;
    this.folded = facts.refoldable;
    this.others = facts.compare;
    get("compare").hidden = facts.running;
    get("refold").hidden = !facts.refoldable;
  }

  fill(name) {
    if (name === "compare") this.fillCompare(); else this.fillRefold();
  }

  fillCompare() {
    const ways = get("compare-ways");
    ways.replaceChildren(...this.others.map(({ text, hint, form }) => this.way(text, hint, async () => {
      const other = await foldAsked(form);
      location.href = `/compare?a=${this.id}&b=${other.id}`;
    })));
    get("compare-form").onsubmit = (event) => {
      event.preventDefault();
      const found = /(?:folds\/|^)([a-z0-9]{8,64})(?:[#?].*)?$/.exec(get("compare-link").value.trim());
      if (found) location.href = `/compare?a=${this.id}&b=${found[1]}`;
      else this.toast("That is no link of a fold");
    };
  }

  // Shapes of the gallery that this chain can become as well.
  async fillRefold() {
    const list = get("refold-shapes");
    if (list.childElementCount) return;
    const answer = await fetch(`/api/folds/${this.id}/refolds`);
    const told = await answer.json().catch(() => ({}));
    if (!answer.ok) { list.replaceChildren(element("p", { class: "hint" }, told.detail ?? "The server did not answer.")); return; }
    if (!told.shapes.length) {
      list.replaceChildren(element("p", { class: "hint" }, "No shape of the gallery has the same number of modules. Drop one of your own below."));
    }
    list.append(...told.shapes.map(({ name, title, modules }) => this.way(title, `${modules} modules`, async () => {
      const refold = await foldAsked({ refold: this.id, shape: name });
      location.href = `/folds/${refold.id}`;
    }, `/shapes/${name}.svg`)));
    get("refold-file").onchange = async (event) => {
      const [file] = event.target.files;
      if (!file) return;
      try {
        location.href = `/folds/${(await foldAsked({ refold: this.id, file })).id}`;
      } catch (error) {
        get("refold-message").textContent = error.message;
      }
      event.target.value = "";
    };
  }

  way(text, hint, go, picture = null) {
    const button = element("button", { class: "way", type: "button" },
      ...(picture ? [element("img", { src: picture, alt: "", width: 56, height: 56, loading: "lazy" })] : []),
      element("span", {}, text, element("small", {}, hint)));
    button.onclick = async () => {
      button.disabled = true;
      try { await go(); } catch (error) { this.toast(error.message); button.disabled = false; }
    };
    return button;
  }
}
