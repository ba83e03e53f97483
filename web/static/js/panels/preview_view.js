// View of a preview page: options and report in the
// panel, and the 3D view or the drawing that replaces it.
import { at, button, countedText, element, get, sentence, integerText } from "../lib/text.js";
import { PreviewStage } from "../viewer/preview_scene.js";
import { hasWebGL, load } from "../viewer/scene.js";
import { showFor } from "./settings.js";
import {
  figuresOf,
  isLossy,
  nearby,
  notesOf,
  oddWords,
  offerOf,
  reachOf,
  troubleOf,
  verdictOf,
} from "./preview_state.js";

const DRAW_MS = 100;
const NO_WEBGL = "WebGL is missing or switched off";
/** @typedef {import("./preview_state.js").Preview} Preview */
/** @typedef {import("./preview_state.js").Offer} Offer */
/** @typedef {import("./preview_state.js").ChoiceName} ChoiceName */

export const radios = /** @type {HTMLInputElement[]} */ ([
  ...document.querySelectorAll(".choice input"),
]);
const layers = /** @type {HTMLElement[]} */ ([...get("layers").children]);

// Return the available values of each choice; the first one is the default.
export function choicesOnPage() {
  /** @type {import("./preview_state.js").Choices} */
  const choices = { module: [], method: [], ends: [], world: [] };
  for (const { name, value } of radios) choices[/** @type {ChoiceName} */ (name)].push(value);
  return choices;
}

// Write texts into elements by their ids.
/** @param {Record<string, string>} texts */
function write(texts) {
  for (const [id, text] of Object.entries(texts)) get(id).textContent = text;
}

// Hide elements, or show them, by their ids.
/** @param {Record<string, boolean>} parts */
function hide(parts) {
  for (const [id, hidden] of Object.entries(parts)) get(id).hidden = hidden;
}

/** @param {string} text */
export function showProblem(text) {
  hide({ problem: !text });
  write({ problem: text });
}

/**
 * @param {Offer} offer
 * @param {(change: Offer["change"]) => void} onChange
 */
const buttonOf = ({ text, primary = false, change }, onChange) =>
  button(primary ? "button primary" : "button", text, () => onChange(change));

// Show the current options, with hints on the chosen ones.
/** @param {Preview} preview */
export function showOptions(preview) {
  const { options, onTable, count, preset, prefer, choosing } = preview;
  for (const input of radios) {
    input.checked = options[/** @type {ChoiceName} */ (input.name)] === input.value;
    if (input.checked && input.dataset.hint)
      get(`${/** @type {"method" | "world" | "ends"} */ (input.name)}-hint`).textContent =
        input.dataset.hint;
    if (input.name === "module")
      input.disabled = onTable && !preview.pathModules.includes(input.value);
    if (input.value === "table") input.disabled = !preview.mayRest;
  }
  if (count !== null) {
    get("modules").value = String(preview.placeOf(count));
    get("modules").setAttribute("aria-valuetext", `${count} modules`);
    get("modules-number").value = String(count);
  }
  get("threshold").value = String(options.threshold ?? 50);
  get("threshold-auto").setAttribute("aria-pressed", String(options.threshold === null));
  get("inside_out").checked = options.inside_out;
  get("thickness").value = String(options.thickness ?? 1);
  get("seed").value = String(options.seed);
  get("preset").value = preset;
  get("preset").disabled = onTable;
  get("prefer").value = prefer;
  get("prefer-part").hidden = !choosing;
  get("prefer-hint").textContent = get("prefer").selectedOptions[0].dataset.hint ?? "";
  get("table-settings").hidden = preview.settable !== "table";
  get("robot-settings").hidden = preview.settable !== "robot";
  get("expected").textContent = preview.expected;
  showFor(preset);
}

/**
 * @param {Preview} preview
 * @param {(change: Offer["change"]) => void} onChange
 */
export function showStart({ start }, onChange) {
  get("start").hidden = !start;
  if (!start) return;
  hide({ "start-button": !start.button });
  write({ "start-text": start.text, "start-button": start.button });
  get("start-button").onclick = () => onChange(start.change);
}

/**
 * @param {ReturnType<typeof troubleOf>} trouble
 * @param {(change: Offer["change"]) => void} onChange
 */
export function showTrouble({ title, details, ways }, onChange) {
  get("trouble").hidden = false;
  get("trouble-title").textContent = title;
  get("problems").replaceChildren(...details.map((detail) => element("li", {}, sentence(detail))));
  get("repairs").replaceChildren(...ways.map((offer) => buttonOf(offer, onChange)));
}

// Show versions of the shape that are known to fold on a table, before the other remedies.
/**
 * @param {Preview} preview
 * @param {(change: Offer["change"]) => void} onChange
 */
export function showOffers({ offers }, onChange) {
  get("repairs").prepend(
    ...offers.map((offer, place) => buttonOf(offerOf(offer, place), onChange)),
  );
  get("to-add").hidden = !offers.some(({ added }) => added.length);
  if (!get("to-add").hidden) get("odd").hidden = false;
}

/**
 * @param {Preview} preview
 * @param {Api.Preview} report
 * @param {(change: Offer["change"]) => void} onChange
 */
export function showReport(preview, report, onChange) {
  const { onTable } = preview;
  const { kind, name, has_path: path } = report;
  const { counts, text } = nearby(preview, report);
  const { iou, likeness, candidates, knot, knotHint, knotted } = figuresOf(report);
  const reach = reachOf(preview, report);
  const odd = oddWords(report);
  const { repaired, unordered, others } = notesOf(preview, report);
  const chain = kind === "chain" || onTable;
  document.title = `${name}, preview · foldback`;
  showTrouble(troubleOf(preview, report), onChange);
  write({
    name,
    verdict: verdictOf(report),
    got: text,
    "reach-limit": reach.limit,
    iou,
    likeness,
    candidates,
    knot,
    long: preview.warning,
    "odd-text": odd,
    "repaired-text": repaired,
    unordered,
    fold: foldWords(report),
  });
  hide({
    what: chain,
    how: chain || kind === "path",
    "method-part": !preview.followsPaths,
    "method-hint": !preview.followsPaths,
    "modules-part": !preview.isScalable,
    "drawn-part": kind !== "word" && kind !== "picture",
    "threshold-part": kind !== "picture",
    "iou-part": !iou,
    "reach-part": !reach.ways.length,
    "reach-limit": !reach.limit,
    "likeness-meaning": !iou,
    trouble: path,
    odd: !odd,
    "odd-cells": !odd,
    "to-add": true,
    repaired: !repaired,
    unordered: !unordered,
    legend: !path,
    "were-added": !report.added?.length,
    layers: false,
  });
  get("nearest").replaceChildren(
    ...counts.map((modules) =>
      button("", integerText(modules), () => onChange({ modules }), {
        title: "A nearby number of modules that may work",
      }),
    ),
  );
  get("match").dataset.tone = isLossy(report) ? "bad" : "";
  get("reach").replaceChildren(
    ...reach.ways.map(({ text: words, label, change }) =>
      button("", words, () => onChange(change), { "aria-label": label, title: label }),
    ),
  );
  get("notes").replaceChildren(...others.map((note) => element("li", {}, note)));
  get("iou-part").style.setProperty("--share", String(report.iou ?? 0));
  get("knot").title = knotHint;
  get("knot").dataset.tone = knotted ? "bad" : "";
  for (const input of radios)
    if (input.name === "method")
      input.disabled =
        Boolean(report.possible_methods?.length) && !report.possible_methods?.includes(input.value);
  for (const chip of layers)
    chip.hidden =
      (chip.dataset.layer === "solid" && kind !== "mesh") ||
      (chip.dataset.layer === "path" && !path);
}

/** @param {Api.Preview} report */
export const foldWords = ({ modules, module_words: words, has_path: path, final = true }) =>
  path ? `Fold ${final ? "" : "about "}${countedText(modules, words)}` : "Fold";

/**
 * @param {string} text
 * @param {string} detail
 */
export function cover(text, detail) {
  get("cover").classList.remove("gone", "drawn");
  get("drawing").hidden = true;
  get("cover").classList.add("still");
  write({ "cover-text": text, "cover-more": detail });
  get("cover-button").hidden = false;
}

// The picture of a report: a drawing until the 3D view is ready, or instead of it.
export class Picture {
  /**
   * @param {{ pick: (module: number | null, cell: number[] | null) => void, settled: () => void }}
   *   heard
   */
  constructor({ pick, settled }) {
    this.settled = settled;
    this.viewing = false; // true while the 3D view is visible
    this.started = false;
    this.leaving = false; // true while the page is about to be left
    this.flat = false; // true if WebGL is not available
    this.failed = false;
    /** @type {Api.Preview | null} */
    this.report = null;
    this.stage = new PreviewStage(get("view"), {
      pick,
      settled,
      shown: () => {
        this.viewing = true;
        hide({ "missing-layer": !this.stage.nodes.has("/missing") });
        this.stage.painted(() => {
          if (this.viewing) get("cover").classList.add("gone");
        });
      },
      failed: () => {
        this.failed = true;
        this.viewing = false;
        this.draw();
      },
    });
    for (const chip of layers) {
      chip.onclick = () => {
        const on = chip.getAttribute("aria-pressed") !== "true";
        chip.setAttribute("aria-pressed", String(on));
        this.stage.layer(chip.dataset.layer ?? "", on);
      };
    }
  }

  get waiting() {
    return this.stage.waiting;
  }

  // Address of the files of the preview.
  get under() {
    return at(`/previews/${this.report?.id}`);
  }

  /** @param {Api.Preview} report */
  show(report) {
    this.report = report;
    this.show3d();
    if (!this.viewing) this.draw();
  }

  // True if the cells that an offer adds are displayed.
  get repaired() {
    return !get("to-add").hidden;
  }

  draw() {
    if (!this.report) return;
    const drawing = get("drawing");
    drawing.onload = () => {
      if (this.viewing) return;
      get("cover").classList.remove("gone", "still");
      get("cover").classList.add("drawn");
      drawing.hidden = false;
      get("cover-button").hidden = true;
      this.explain();
      setTimeout(() => this.start(), DRAW_MS);
    };
    drawing.onerror = () => {
      drawing.hidden = true;
      this.explain();
      this.start();
    };
    const repair = this.repaired ? "&repair=true" : "";
    drawing.src = `${this.under}/drawing.svg?key=${this.report.key}${repair}`;
  }

  explain() {
    const reason = this.flat ? NO_WEBGL : this.failed ? "The 3D view could not be loaded" : "";
    write({
      "cover-text": reason ? `${reason}, so you see a drawing.` : "Starting the 3D view…",
      "cover-more": reason
        ? `The numbers on this page are still correct` +
          `${this.report?.has_path ? ", and you can fold the shape" : ""}.`
        : "",
    });
  }

  // The check starts the browser's 3D graphics, which takes a second with software rendering.
  start() {
    if (this.started || this.leaving) return;
    this.started = true;
    this.flat = !hasWebGL();
    if (!this.flat) {
      load(/** @type {HTMLIFrameElement} */ (get("view")), at("/view"));
      this.show3d();
      return;
    }
    if (get("drawing").hidden)
      cover(
        "This browser cannot show 3D graphics",
        `${NO_WEBGL}. The numbers on this page are still correct, and you can fold the shape.`,
      );
    else this.explain();
  }

  // Do not start the 3D view of a page that is about to be left: the next page starts its own.
  hold() {
    this.leaving = true;
  }

  // Start the 3D view after all, because the page stays.
  release() {
    this.leaving = false;
    if (this.report) this.start();
  }

  show3d() {
    if (!this.started || this.flat || !this.report) return;
    this.failed = false;
    this.stage.show(`${this.under}/scene/${this.report.key}${this.repaired ? "?repair=true" : ""}`);
    this.settled();
  }
}
