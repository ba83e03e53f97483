// Cards of what this browser has made: folds, shapes that were looked at, movies.
import { asked, deleted, Refusal } from "../lib/made.js";
import { STAGES, copyText, element, sentence, span, whole, wordsOf } from "../lib/text.js";
import { confirmed } from "./confirm.js";
import { toast } from "./toast.js";

const LONGEST_NAME = 200;
const S = 1000;
/** @type {Record<string, string>} */
const METHODS = { direct: "direct servoing", paper: "published method" };
/** @type {Record<string, string>} */
const PLURALS = { cube: "modules", tetrahedron: "tetrahedra" };

/** @param {string} moment */
const ago = (moment) => {
  const age = (Date.now() - Date.parse(moment)) / S;
  return age < 60 ? "just now" : `${span(age)}\u00a0ago`;
};

/** @param {string} moment */
const keptFor = (moment) => `kept\u00a0${span(Math.max(0, Date.parse(moment) - Date.now()) / S)}\u00a0more`;

/**
 * @param {string} text
 * @param {string} of what it is about, for who hears it
 * @param {() => void} press
 */
function way(text, of, press) {
  const button = element("button", { type: "button", class: "way", "aria-label": `${text}: ${of}` }, text);
  button.onclick = press;
  return button;
}

// What has come of a fold, and how that is coloured; its page tells why.
/** @param {FoldMade} fold */
function verdictOf({ status, stage, progress, summary }) {
  if (status === "verified") return { tone: "verified", text: sentence(summary.certificate?.verdict ?? "verified") };
  if (status === "failed") return { tone: "failed", text: "Not verified" };
  if (status === "cancelled") return { tone: "off", text: "Cancelled" };
  if (status === "queued") return { tone: "running", text: "In the queue" };
  return { tone: "running", text: `${STAGES[stage ?? ""] ?? "Computing"} ${Math.floor(100 * (progress.fraction ?? 0))} %` };
}

// The words of a card for a fold that is not by the default method or not in zero gravity; as server/pages/cards.py.
/** @param {Pick<FoldMade, "preset" | "world">} fold */
export const methodWords = ({ preset, world }) => [METHODS[preset] ?? "", world === "table" ? "on a table" : ""].filter(Boolean).join(", ");

// A picture that leads to a page, for who sees; the title says the same to all.
/**
 * @param {string} page
 * @param {string} drawing
 * @param {string | null} instead where there is no drawing
 */
function art(page, drawing, instead = null) {
  const image = element("img", { src: drawing, alt: "", loading: "lazy", decoding: "async", width: 160, height: 136 });
  image.onerror = () => {
    image.onerror = () => { image.hidden = true; };
    if (instead) image.src = instead; else image.hidden = true;
  };
  return element("a", { class: "card-art", href: page, tabindex: "-1", "aria-hidden": "true" }, image);
}

export class FoldCard {
  /**
   * @param {FoldMade} fold
   * @param {string} key
   * @param {() => void} gone
   */
  constructor(fold, key, gone) {
    this.fold = fold;
    this.key = key;
    this.gone = gone;
    this.title = element("h3", { class: "card-title" });
    this.verdict = element("p", { class: "card-status" });
    this.facts = element("p", { class: "card-count" });
    this.ways = element("div", { class: "ways" });
    this.item = element("li", { class: "made", "data-id": fold.id },
      art(fold.links.page, fold.links.drawing, `${fold.links.page}/picture.png`), this.title, this.verdict, this.facts, this.ways);
    this.show();
  }

  get running() { return this.fold.status === "queued" || this.fold.status === "running"; }

  show() {
    const { fold } = this;
    const { tone, text } = verdictOf(fold);
    this.title.replaceChildren(element("a", { href: fold.links.page }, fold.title));
    this.verdict.textContent = text;
    this.verdict.dataset.status = tone;
    const kept = fold.public ? "in the gallery" : fold.expires_at && keptFor(fold.expires_at);
    this.facts.textContent = [`${whole(fold.modules)} ${PLURALS[fold.module] ?? "modules"}`, methodWords(fold), ago(fold.created_at), kept].filter(Boolean).join(" · ");
    this.ways.replaceChildren(
      way("Copy link", fold.title, () => this.copy()),
      ...(fold.public ? [] : [way("Rename", fold.title, () => this.rename()), way("Delete", fold.title, () => this.remove())]));
  }

  async refresh() {
    try {
      this.fold = await asked("GET", this.fold.links.self);
      if (!this.title.hidden) this.show();
    } catch (error) {
      if (error instanceof Refusal && error.gone) this.away();
    }
  }

  copy() {
    const link = location.origin + this.fold.links.page;
    copyText(link, () => toast("Link copied"), () => toast(link));
  }

  rename() {
    const input = element("input", { type: "text", maxlength: LONGEST_NAME, value: this.fold.title, "aria-label": "New name", required: true, autocomplete: "off" });
    const form = element("form", { class: "renaming" }, input,
      element("button", { class: "button primary", type: "submit" }, "Save"));
    const back = () => {
      form.remove();
      this.title.hidden = false;
      this.show();
      /** @type {HTMLElement | null} */ (this.ways.children[1])?.focus();
    };
    input.onkeydown = (event) => { if (event.key === "Escape") back(); };
    form.onsubmit = async (event) => {
      event.preventDefault();
      if (input.value === this.fold.title) { back(); return; }
      try {
        this.fold = await asked("PATCH", this.fold.links.self, this.key, { name: input.value });
        back();
      } catch (error) {
        toast(wordsOf(error));
        input.focus();
      }
    };
    const cancel = element("button", { class: "way", type: "button" }, "Cancel");
    cancel.onclick = back;
    this.title.hidden = true;
    this.title.after(form);
    this.ways.replaceChildren(cancel);
    input.select();
  }

  async remove() {
    const sure = await confirmed(`Delete “${this.fold.title}”?`, "This permanently deletes the fold, its plan and its movies. The link will stop working for everyone.", "Delete");
    if (sure) await removed(this, this.fold.links.self);
  }

  away() {
    this.item.remove();
    this.gone();
  }
}

export class PreviewCard {
  /**
   * @param {PreviewMade} preview
   * @param {string} key
   * @param {() => void} gone
   */
  constructor({ id, title, module, modules, created_at: made, expires_at: end, page, drawing }, key, gone) {
    this.key = key;
    this.gone = gone;
    const facts = `${whole(modules)} ${PLURALS[module] ?? "modules"} · ${ago(made)} · ${keptFor(end)}`;
    this.item = element("li", { class: "made", "data-id": id }, art(page, drawing),
      element("h3", { class: "card-title" }, element("a", { href: page }, title)),
      element("p", { class: "card-count" }, facts),
      element("div", { class: "ways" }, way("Delete", title, async () => {
        const sure = await confirmed(`Delete “${title}”?`, "This permanently deletes the uploaded file. Folds made from it stay.", "Delete");
        if (sure) await removed(this, `/api/mine/previews/${id}`);
      })));
  }

  away() {
    this.item.remove();
    this.gone();
  }
}

export class MovieLine {
  /**
   * @param {MovieMade} made
   * @param {string} key
   * @param {() => void} gone
   */
  constructor({ title, created_at: moment, movie }, key, gone) {
    this.key = key;
    this.gone = gone;
    this.title = title;
    this.movie = movie;
    this.state = element("span", { class: "card-count" });
    this.ways = element("div", { class: "ways" });
    const facts = [movie.format.toUpperCase(), `${movie.width} × ${movie.height}`, `${movie.seconds} s`, ago(moment)].join(" · ");
    this.item = element("li", { class: "movie" },
      element("div", {}, element("a", { href: movie.links.fold.replace("/api", "") }, title), element("span", { class: "card-count" }, facts), this.state), this.ways);
    this.show();
  }

  get running() { return this.movie.status === "queued" || this.movie.status === "running"; }

  show() {
    const { status, frames_done: done, frames_total: total, problem, links, format } = this.movie;
    const words = { queued: "Waiting in the queue", running: `Picture ${done} of ${total}`, ready: "", failed: sentence(problem?.detail ?? "It could not be created.") };
    this.state.textContent = words[status];
    const file = status === "ready" ? element("a", { class: "way", href: links.file, download: true, "aria-label": `Download ${format.toUpperCase()}: ${this.title}` }, "Download") : null;
    this.ways.replaceChildren(...(file ? [file] : []), way("Delete", `movie of ${this.title}`, async () => {
      const sure = await confirmed(`Delete the movie of “${this.title}”?`, "You can create it again on the fold’s page.", "Delete");
      if (sure) await removed(this, links.self);
    }));
  }

  async refresh() {
    try {
      this.movie = await asked("GET", this.movie.links.self);
      this.show();
    } catch (error) {
      if (error instanceof Refusal && error.gone) this.away();
    }
  }

  away() {
    this.item.remove();
    this.gone();
  }
}

// Deletes what a card shows; who uses the keyboard goes on with the card beside it.
/**
 * @param {{ key: string, item: HTMLElement, away: () => void }} card
 * @param {string} address
 */
async function removed(card, address) {
  const beside = card.item.nextElementSibling ?? card.item.previousElementSibling;
  try {
    await deleted(address, card.key);
    card.away();
    /** @type {HTMLElement | null | undefined} */ (beside?.querySelector("a:not([tabindex])"))?.focus();
    toast("Deleted");
  } catch (error) {
    toast(wordsOf(error));
  }
}
