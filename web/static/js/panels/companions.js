// Where one goes from a fold: beside another one, or on into another shape.
import { ask } from "../lib/api.js";
import { openFold, requestFold } from "../lib/fold_request.js";
import { changed, open, refused } from "./paper_settings.js";
import { Sending } from "./sending.js";
import { addStyle } from "../lib/style.js";
import { at, element, get, wordsOf } from "../lib/text.js";

const STYLE = "/static/css/paper_settings.css";

export class Companions {
  /** @param {(text: string) => void} toast */
  constructor(toast) {
    this.toast = toast;
    addStyle(STYLE);
    get("refold-file").onchange = () => this.refoldInto(get("refold-file"));
    this.sending = new Sending(get("refold-sending"));
    this.id = "";
    /** @type {Way[]} */
    this.others = [];
    /** @type {Form} */
    this.published = {};
    this.filled = false;
  }

  /** @param {Facts} facts */
  facts(facts) {
    this.id = facts.id;
    this.others = facts.compare;
    this.published = facts.refold;
  }

  compare() {
    this.fillCompare();
    get("compare-dialog").showModal();
  }

  refold() {
    this.fillRefold();
    get("refold-dialog").showModal();
  }

  fillCompare() {
    const ways = get("compare-ways");
    get("paper-settings").hidden = !this.others.some(({ settable }) => settable);
    ways.replaceChildren(...this.others.map(({ text, hint, form, id, settable }) => this.way(text, hint, async () => {
      if (!id && settable) return this.comparePublished(form, settable);
      location.href = at(id ? `/compare?a=${id}&b=${this.id}` : `/compare?a=${this.id}&b=${(await requestFold(form)).id}`);
      return false;
    })));
    get("compare-form").onsubmit = (event) => {
      event.preventDefault();
      const found = /(?:folds\/|^)([a-z0-9]{8,64})(?:[#?].*)?$/.exec(get("compare-link").value.trim());
      if (found) location.href = at(`/compare?a=${this.id}&b=${found[1]}`);
      else this.toast("This is not a link to a fold");
    };
  }

  // Beside the published method, with settings of one's own where there are some, or must be. True
  // when the page stays.
  /**
   * @param {Form} form
   * @param {string} settable
   */
  async comparePublished(form, settable) {
    const settings = changed();
    get("compare-message").textContent = "";
    if (settable === "must" && !settings.settings) { get("compare-message").textContent = "Change a setting below."; open(); return true; }
    try {
      location.href = at(`/compare?a=${this.id}&b=${(await requestFold({ ...form, ...settings })).id}`);
    } catch (error) {
      get("compare-message").textContent = refused(wordsOf(error));
      return true;
    }
    return false;
  }

  // Shapes of the gallery that this chain can become as well.
  async fillRefold() {
    if (this.filled) return;
    const list = get("refold-shapes");
    const hint = (/** @type {string} */ text) => list.replaceChildren(element("p", { class: "hint" }, text));
    /** @type {Api.Shapes | null} */
    const answer = await ask(`/api/folds/${this.id}/refolds`).catch((error) => { hint(wordsOf(error)); return null; });
    if (!answer) return;
    const { shapes } = answer;
    this.filled = true;
    if (!shapes.length) hint("No gallery shape has the same number of modules. Upload your own shape.");
    else list.replaceChildren(...shapes.map(({ name, title, modules }) => this.way(title, `${modules} modules`, async () => {
      const refold = await requestFold({ refold: this.id, shape: name, ...this.published });
      location.href = at(`/folds/${refold.id}`);
      return false;
    }, `/shapes/${name}.svg`)));
  }

  async smooth() {
    get("smooth").disabled = true;
    const problem = await openFold({ smooth: this.id });
    if (problem) this.toast(problem);
    get("smooth").disabled = false;
  }

  /** @param {HTMLInputElement} field */
  async refoldInto(field) {
    const [file] = field.files ?? [];
    field.value = "";
    if (!file) return;
    get("refold-message").textContent = "";
    try {
      const { id } = await this.sending.during(file.name, (how) => requestFold({ refold: this.id, file, ...this.published }, how));
      location.href = at(`/folds/${id}`);
    } catch (error) {
      get("refold-message").textContent = wordsOf(error);
    }
  }

  /**
   * @param {string} text
   * @param {string} hint
   * @param {() => Promise<boolean>} go
   * @param {string | null} picture
   */
  way(text, hint, go, picture = null) {
    const button = element("button", { class: "way", type: "button" },
      ...(picture ? [element("img", { src: picture, alt: "", width: 56, height: 56, loading: "lazy" })] : []),
      element("span", {}, text, element("small", {}, hint)));
    button.onclick = async () => {
      button.disabled = true;
      try { if (await go()) button.disabled = false; } catch (error) { this.toast(wordsOf(error)); button.disabled = false; }
    };
    return button;
  }
}
