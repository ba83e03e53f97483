// Cards of items made with this browser: folds, previews, movies.
import { ask, askUntil, remove } from "../lib/api.js";
import {
  at,
  button,
  copyText,
  countedText,
  element,
  percent,
  sentence,
  STAGES,
  toast,
  wordsOf,
} from "../lib/text.js";
import { confirmed, renamed } from "./dialogs.js";

const S = 1000;
const LOOK_MS = 3000;
/** @type {Record<string, string>} */
const METHODS = {
  direct: "joints turned directly",
  paper: "method from the paper",
};

// Return a duration in whole minutes, hours or days.
/** @param {number} value in seconds */
export function span(value) {
  if (value < 90 * 60) return `${Math.max(1, Math.round(value / 60))}\u00a0min`;
  if (value < 36 * 3600) return `${Math.round(value / 3600)}\u00a0h`;
  return `${Math.round(value / 86400)}\u00a0days`;
}

/** @param {string} moment */
const ago = (moment) => {
  const age = (Date.now() - Date.parse(moment)) / S;
  return age < 60 ? "just now" : `${span(age)}\u00a0ago`;
};

/** @param {string} moment */
const expiryOf = (moment) =>
  `expires in\u00a0${span(Math.max(0, Date.parse(moment) - Date.now()) / S)}`;

/**
 * @param {string} text
 * @param {string} of name of the item, for screen readers
 * @param {() => void} press
 */
const way = (text, of, press, danger = false) =>
  button(danger ? "way danger" : "way", text, press, { "aria-label": `${text}: ${of}` });

// Return the verdict of a fold and its tone; the page of the fold shows the reason.
/** @param {Api.Fold} fold */
export function verdictOf({ status, stage, progress }) {
  if (status === "verified") return { tone: "verified", text: "Verified" };
  if (status === "failed") return { tone: "failed", text: "Not verified" };
  if (status === "cancelled") return { tone: "off", text: "Cancelled" };
  if (status === "queued") return { tone: "running", text: "In the queue" };
  return {
    tone: "running",
    text: `${STAGES[stage ?? ""] ?? "Computing"} ${Math.floor(100 * (progress.fraction ?? 0))} %`,
  };
}

// Return the method and environment of a fold if they are not the default; as
// server/pages/cards.py.
/** @param {Pick<Api.Fold, "preset" | "world">} fold */
const methodWords = ({ preset, world }) =>
  [METHODS[preset] ?? "", world === "table" ? "on a table" : ""].filter(Boolean).join(", ");

// Return facts about a fold: size, likeness to its file, method, age, and how long it is kept.
/** @param {Api.Fold} fold */
export function factsOf(fold) {
  const { likeness } = /** @type {{ likeness?: { iou: number } | null }} */ (fold.summary);
  return [
    countedText(fold.modules, fold.module_words),
    likeness ? `${percent(likeness.iou)} like the file` : "",
    methodWords(fold),
    ago(fold.created_at),
    fold.public ? "in the gallery" : fold.expires_at && expiryOf(fold.expires_at),
  ]
    .filter(Boolean)
    .join(" · ");
}

const runs = (/** @type {{ status: string }} */ { status }) =>
  status === "queued" || status === "running";

// Return a picture that links to a page. Screen readers
// skip it, because the title has the same link.
/**
 * @param {string} page
 * @param {string} drawing
 * @param {string | null} instead picture to use if there is no drawing
 */
function art(page, drawing, instead = null) {
  const image = element("img", {
    src: drawing,
    alt: "",
    loading: "lazy",
    decoding: "async",
    width: 160,
    height: 136,
  });
  image.onerror = () => {
    image.onerror = () => {
      image.hidden = true;
    };
    if (instead) image.src = at(instead);
    else image.hidden = true;
  };
  return element(
    "a",
    { class: "card-art", href: page, tabindex: "-1", "aria-hidden": "true" },
    image,
  );
}

// Base of all cards. A card is removed when its item no longer exists.
class Card {
  /**
   * @param {HTMLLIElement} item
   * @param {string} key
   * @param {() => void} onDeleted
   */
  constructor(item, key, onDeleted) {
    this.item = item;
    this.key = key;
    this.onDeleted = onDeleted;
  }

  away() {
    this.item.remove();
    this.onDeleted();
  }

  // Poll a running item while its card is on the page; `take` returns true while it runs.
  /**
   * @template Answer
   * @param {string} address
   * @param {(answer: Answer) => boolean} take
   */
  follow(address, take) {
    askUntil(
      address,
      LOOK_MS,
      (/** @type {Answer} */ answer) => !take(answer) || !this.item.isConnected,
    ).catch(() => {
      if (this.item.isConnected) this.away();
    });
  }

  // Return the button that deletes the item after a
  // confirmation; the focus moves to the adjacent card.
  /**
   * @param {string} label name of the item, for screen readers
   * @param {string} address
   * @param {[question: string, consequence: string]} question
   */
  deletion(label, address, question) {
    return way(
      "Delete",
      label,
      async () => {
        if (!(await confirmed(...question, "Delete", true))) return;
        const beside = this.item.nextElementSibling ?? this.item.previousElementSibling;
        try {
          await remove(address, this.key);
          this.away();
          /** @type {HTMLElement | null | undefined} */ (
            beside?.querySelector("a:not([tabindex])")
          )?.focus();
          toast("Deleted");
        } catch (error) {
          toast(wordsOf(error));
        }
      },
      true,
    );
  }
}

export class FoldCard extends Card {
  /**
   * @param {Api.Fold} fold
   * @param {string} key
   * @param {() => void} onDeleted
   */
  constructor(fold, key, onDeleted) {
    super(element("li", { class: "made", "data-id": fold.id }), key, onDeleted);
    this.fold = fold;
    this.title = element("h3", { class: "card-title" });
    this.verdict = element("p", { class: "card-status" });
    this.facts = element("p", { class: "card-count" });
    this.ways = element("div", { class: "ways" });
    this.item.append(
      art(fold.links.page, fold.links.drawing, `${fold.links.page}/picture.png`),
      this.title,
      this.verdict,
      this.facts,
      this.ways,
    );
    this.show();
    this.offer();
    if (runs(fold))
      this.follow(fold.links.self, (/** @type {Api.Fold} */ now) => {
        this.fold = now;
        this.show();
        return runs(now);
      });
  }

  show() {
    const { fold } = this;
    const { tone, text } = verdictOf(fold);
    this.title.replaceChildren(element("a", { href: fold.links.page }, fold.title));
    this.verdict.textContent = text;
    this.verdict.dataset.status = tone;
    this.facts.textContent = factsOf(fold);
  }

  offer() {
    const { fold } = this;
    this.ways.replaceChildren(
      way("Copy link", fold.title, () => this.copy()),
      ...(fold.public
        ? []
        : [
            way("Rename", fold.title, () => this.rename()),
            this.deletion(fold.title, fold.links.self, [
              `Delete “${fold.title}”?`,
              "This permanently deletes the fold, its plan and its movies. The link will stop " +
                "working for everyone.",
            ]),
          ]),
    );
  }

  copy() {
    const link = location.origin + at(this.fold.links.page);
    copyText(
      link,
      () => toast("Link copied"),
      () => toast(link),
    );
  }

  async rename() {
    const { title, links } = this.fold;
    const done = await renamed(title, async (name) => {
      this.fold = await ask(links.self, { method: "PATCH", token: this.key, body: { name } });
    });
    if (!done) return;
    this.show();
    this.offer();
    /** @type {HTMLElement} */ (this.ways.children[1]).focus();
  }
}

export class PreviewCard extends Card {
  /**
   * @param {Api.OwnedPreview} preview
   * @param {string} key
   * @param {() => void} onDeleted
   */
  constructor(
    {
      id,
      title,
      module_words: words,
      modules,
      created_at: createdAt,
      expires_at: end,
      page,
      drawing,
    },
    key,
    onDeleted,
  ) {
    super(element("li", { class: "made", "data-id": id }, art(page, drawing)), key, onDeleted);
    const facts = `${countedText(modules, words)} · ${ago(createdAt)} · ${expiryOf(end)}`;
    this.item.append(
      element("h3", { class: "card-title" }, element("a", { href: page }, title)),
      element("p", { class: "card-count" }, facts),
      element(
        "div",
        { class: "ways" },
        this.deletion(title, `/api/mine/previews/${id}`, [
          `Delete “${title}”?`,
          "This permanently deletes the uploaded file. Folds made from it stay.",
        ]),
      ),
    );
  }
}

export class MovieLine extends Card {
  /**
   * @param {Api.OwnedMovie} made
   * @param {string} key
   * @param {() => void} onDeleted
   */
  constructor({ title, created_at: moment, movie }, key, onDeleted) {
    super(element("li", { class: "movie" }), key, onDeleted);
    this.title = title;
    this.movie = movie;
    this.state = element("span", { class: "card-count" });
    this.ways = element("div", { class: "ways" });
    const facts = [
      movie.format.toUpperCase(),
      `${movie.width} × ${movie.height}`,
      `${movie.seconds} s`,
      ago(moment),
    ].join(" · ");
    this.item.append(
      element(
        "div",
        {},
        element("a", { href: movie.links.fold.replace("/api", "") }, title),
        element("span", { class: "card-count" }, facts),
        this.state,
      ),
      this.ways,
    );
    this.show();
    if (runs(movie))
      this.follow(movie.links.self, (/** @type {Api.MovieBody} */ now) => {
        this.movie = now;
        this.show();
        return runs(now);
      });
  }

  show() {
    const { status, frames_done: done, frames_total: total, problem, links, format } = this.movie;
    const words = {
      queued: "Waiting in the queue",
      running: `Recording picture ${done} of ${total}`,
      ready: "",
      failed: sentence(
        problem?.detail ?? "The movie could not be created. Try again on the fold’s page.",
      ),
    };
    this.state.textContent = words[status];
    const file =
      status === "ready"
        ? [
            element(
              "a",
              {
                class: "way",
                href: links.file,
                download: true,
                "aria-label": `Download ${format.toUpperCase()}: ${this.title}`,
              },
              "Download",
            ),
          ]
        : [];
    this.ways.replaceChildren(
      ...file,
      this.deletion(`movie of ${this.title}`, links.self, [
        `Delete the movie of “${this.title}”?`,
        "You can create the movie again on the fold’s page.",
      ]),
    );
  }
}
