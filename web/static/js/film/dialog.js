// The dialog that makes a film of the fold in this browser, and saves or shares it.
import { FPS, readingSeconds } from "./schedule.js";
import { encode } from "./encode.js";
import { encodingsFor, recordingType } from "./formats.js";
import { Pictures } from "./pictures.js";
import { record } from "./record.js";
import { addStyle } from "../lib/lazy_styles.js";
import { button, element, duration, save, svg, toast, wordsOf } from "../lib/text.js";

const STYLE = "/static/css/film.css";
/** @type {Record<string, { label: string, width: number, height: number }>} */
const SHAPES = {
  upright: { label: "Upright", width: 1080, height: 1920 },
  square: { label: "Square", width: 1080, height: 1080 },
  wide: { label: "Wide", width: 1920, height: 1080 },
};
const LENGTHS = [5, 10, 15, 20, 30]; // seconds
const USUAL_LENGTH = 10;
const MAX_TITLE = 80; // characters
const PREVIEW_PX = 480; // longer side of the small picture
const PREVIEW_EVERY = 6; // pictures of the film between two of the small picture
const MEASURED = 15; // pictures, from which the remaining time is estimated
const NOTHING =
  "This browser cannot make videos. Try a current version of Chrome, Edge, Firefox or Safari.";

/**
 * @typedef {object} Filmed
 * @property {import("../player/player.js").Player} player
 * @property {() => string} name of the fold
 * @property {() => Promise<Tour | null>} tour
 */

// Return the function that opens the dialog.
/** @param {Filmed} filmed */
export function filming(filmed) {
  const dialog = new FilmDialog(filmed);
  return () => dialog.open();
}

class FilmDialog {
  /** @type {AbortController | null} */
  making = null;
  /** @type {File | null} */
  file = null;
  /** @type {Tour | null} */
  tour = null;
  drawn = 0; // number of the latest small picture that was requested

  /** @param {Filmed} filmed */
  constructor(filmed) {
    this.filmed = filmed;
    addStyle(STYLE);
    const shape = innerHeight > innerWidth ? "upright" : "square";
    this.preview = element("canvas", { class: "film-preview", "aria-hidden": "true" });
    this.shapes = element(
      "fieldset",
      { class: "film-shapes" },
      element("legend", {}, "Shape"),
      ...Object.entries(SHAPES).map(([name, { label }]) =>
        element(
          "label",
          { class: `film-shape ${name}` },
          element("input", { type: "radio", name: "shape", value: name, checked: name === shape }),
          element("i", { "aria-hidden": "true" }),
          label,
        ),
      ),
    );
    this.title = element("input", { name: "title", maxlength: MAX_TITLE, autocomplete: "off" });
    this.length = menu(
      "seconds",
      LENGTHS.map((s) => [String(s), `${s} s`]),
      String(USUAL_LENGTH),
    );
    this.part = menu("part", [
      ["", "Folding"],
      ["whole", "Unfolding and folding"],
    ]);
    this.format = menu("format", []);
    this.captions = element("input", { type: "checkbox", name: "captions" });
    this.make = element("button", { type: "submit", class: "button primary" }, "Make film");
    this.form = element(
      "form",
      { class: "film-form" },
      this.shapes,
      labelled("Title (optional)", this.title),
      element(
        "div",
        { class: "film-row" },
        labelled("Length", this.length),
        labelled("Content", this.part),
      ),
      (this.formatField = labelled("Format", this.format)),
      element("label", { class: "check" }, this.captions, " Captions from the tour"),
      element("div", { class: "film-actions" }, this.make),
    );
    this.bar = element("progress", { max: 1, value: 0, "aria-label": "Film" });
    this.count = element("p", { class: "hint" });
    this.stop = button("button", "Cancel", () => this.making?.abort());
    this.work = element(
      "div",
      { class: "film-work", hidden: true },
      this.bar,
      this.count,
      this.stop,
    );
    this.share = button("button primary", "Share…", () => this.send());
    this.download = button("button", "Download", () => {
      if (this.file) save(this.file, this.file.name);
    });
    this.again = button("button quiet", "Change", () => this.enter("choosing"));
    this.done = element(
      "div",
      { class: "film-actions", hidden: true },
      this.share,
      this.download,
      this.again,
    );
    this.state = element("p", { class: "film-state", role: "status" });
    this.box = this.assembled();
    this.form.oninput = ({ target }) => this.changed(target);
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.begin();
    };
    this.box.addEventListener("close", () => this.making?.abort());
    document.body.append(this.box);
  }

  assembled() {
    const close = element("button", {
      class: "icon-button dialog-close",
      "aria-label": "Close",
      title: "Close",
    });
    close.append(svg("svg", { class: "icon" }, svg("use", { href: "#i-close" })));
    return element(
      "dialog",
      { id: "film-dialog", class: "dialog film", "aria-labelledby": "film-title" },
      element("form", { method: "dialog" }, close),
      element("h2", { id: "film-title" }, "Make a film"),
      element(
        "div",
        { class: "film-parts" },
        element("div", { class: "film-screen" }, this.preview),
        element(
          "div",
          { class: "film-side" },
          this.form,
          this.work,
          this.state,
          this.done,
          element(
            "p",
            { class: "hint" },
            "The film shows the camera and the colours of this page. Your browser makes it; " +
              "nothing is sent.",
          ),
        ),
      ),
    );
  }

  open() {
    if (!this.filmed.player.timeline.chain) {
      toast("There is no motion to film yet.");
      return;
    }
    this.title.value ||= this.filmed.name();
    if (!this.making) this.enter("choosing");
    this.box.showModal();
    this.offer();
    this.show();
  }

  get size() {
    const { value } = /** @type {RadioNodeList} */ (this.form.elements.namedItem("shape"));
    return SHAPES[value];
  }

  /** @returns {import("./pictures.js").FilmOptions} */
  get options() {
    const { width, height } = this.size;
    return {
      width,
      height,
      seconds: Number(this.length.value),
      whole: this.part.value === "whole",
      title: this.title.value,
      stops: this.captions.checked ? (this.tour?.stops ?? []) : [],
    };
  }

  /** @param {EventTarget | null} field */
  async changed(field) {
    if (field === this.captions && this.captions.checked) await this.loadTour();
    if (/** @type {HTMLInputElement} */ (field).name === "shape") this.offer();
    this.show();
  }

  // Load the tour, and choose a length in which its captions can be read.
  async loadTour() {
    this.tour ??= await this.filmed.tour().catch(() => null);
    if (!this.tour?.stops.length) {
      this.captions.checked = false;
      this.say("This fold has no tour yet.");
      return;
    }
    const needed =
      Number(this.length.value) +
      this.tour.stops.reduce((sum, { caption }) => sum + readingSeconds(caption), 0);
    this.length.value = String(LENGTHS.find((s) => s >= needed) ?? LENGTHS.at(-1));
  }

  // Offer the formats that this browser can make at the chosen size.
  async offer() {
    const encodings = await encodingsFor(this.size, FPS);
    this.encodings = encodings;
    const before = this.format.value;
    this.format.replaceChildren(
      ...encodings.map(({ container }) =>
        element("option", { value: container, selected: container === before }, label(container)),
      ),
    );
    this.formatField.hidden = encodings.length < 2;
    const type = encodings.length ? null : recordingType();
    this.make.disabled = !encodings.length && !type;
    if (this.make.disabled) this.say(NOTHING);
    else if (type) this.say("This browser records the film while it plays.");
  }

  // Show the last picture of the film as it is chosen now.
  async show() {
    const number = ++this.drawn;
    const pictures = new Pictures(this.filmed.player, this.options);
    await pictures.prepare();
    if (number !== this.drawn) return;
    const picture = await pictures.at(pictures.count - 1);
    if (number === this.drawn) this.paint(picture);
    picture.close();
  }

  /** @param {ImageBitmap} picture */
  paint(picture) {
    const { preview } = this;
    const scale = PREVIEW_PX / Math.max(picture.width, picture.height);
    const [width, height] = [picture.width, picture.height].map((v) => Math.round(v * scale));
    if (preview.width !== width || preview.height !== height)
      Object.assign(preview, { width, height });
    const pen = preview.getContext("2d");
    if (!pen) return;
    pen.imageSmoothingQuality = "medium";
    pen.drawImage(picture, 0, 0, width, height);
  }

  async begin() {
    const { player } = this.filmed;
    const making = (this.making = new AbortController());
    this.drawn++; // no small picture of the choices any more
    this.enter("making");
    player.send({ do: "pause" });
    player.standIn?.hold(true);
    try {
      const file = await this.made(making.signal);
      this.making = null;
      this.finish(file);
    } catch (error) {
      this.making = null;
      this.enter("choosing");
      this.say(making.signal.aborted ? "Cancelled." : `The film was not made. ${wordsOf(error)}`);
      this.show();
    }
    player.standIn?.hold(false);
    player.show(true);
  }

  /**
   * @param {AbortSignal} signal
   * @returns {Promise<Blob>}
   */
  async made(signal) {
    const pictures = new Pictures(this.filmed.player, this.options, signal);
    await pictures.prepare();
    const startMs = performance.now();
    const progress = (/** @type {ImageBitmap} */ picture, /** @type {number} */ done) => {
      const { count } = pictures;
      this.bar.value = done / count;
      const leftS = (((performance.now() - startMs) / done) * (count - done)) / 1000;
      const left = done < MEASURED ? "" : `, ${duration(leftS)} left`;
      this.count.textContent = `Picture ${done} of ${count}${left}`;
      if (done % PREVIEW_EVERY === 0 || done === count) this.paint(picture);
    };
    const encoding = this.encodings?.find(({ container }) => container === this.format.value);
    const making = { pictures, signal, progress };
    return encoding ? encode(encoding, making) : record(recordingType() ?? "", making);
  }

  /** @param {Blob} film */
  finish(film) {
    const ending = film.type.replace("video/", "");
    const name = `${this.filmed.name().replaceAll(/[\\/:*?"<>|]/g, " ")}.${ending}`;
    this.file = new File([film], name, { type: film.type });
    this.share.hidden = !navigator.canShare?.({ files: [this.file] });
    this.download.classList.toggle("primary", this.share.hidden);
    this.enter("done");
    const size = `${(film.size / 1e6).toFixed(1)} MB`;
    this.say(`Your film is ready: ${this.length.value} s, ${label(ending)}, ${size}.`);
  }

  async send() {
    if (!this.file) return;
    try {
      await navigator.share({ files: [this.file], title: this.file.name });
    } catch (error) {
      if (!(error instanceof DOMException && error.name === "AbortError"))
        this.say("The film could not be shared. Download it instead.");
    }
  }

  /** @param {"choosing" | "making" | "done"} part */
  enter(part) {
    this.form.hidden = part !== "choosing";
    this.work.hidden = part !== "making";
    this.done.hidden = part !== "done";
    this.say("");
    this.bar.value = 0;
    this.count.textContent = "Starting…";
    if (!this.box.open) return;
    if (part === "making") this.stop.focus();
    else if (part === "done") (this.share.hidden ? this.download : this.share).focus();
    else this.make.focus();
  }

  /** @param {string} text */
  say(text) {
    this.state.textContent = text;
  }
}

/** @param {string} container */
const label = (container) => (container === "mp4" ? "MP4" : "WebM");

/**
 * @param {string} text
 * @param {HTMLElement} field
 */
const labelled = (text, field) => element("label", { class: "film-field" }, text, field);

/**
 * @param {string} name
 * @param {[value: string, text: string][]} choices
 * @param {string} chosen
 */
const menu = (name, choices, chosen = "") =>
  element(
    "select",
    { name },
    ...choices.map(([value, text]) =>
      element("option", { value, selected: value === chosen }, text),
    ),
  );
