// A whole fold in one file: everything that the page needs is in the page.
import { decode } from "../lib/columns.js";
import { Drawer } from "../panels/drawer.js";
import { ModulePanel } from "../panels/module_panel.js";
import { Plots } from "../panels/plots.js";
import { Figures } from "../player/figures.js";
import { Sketch } from "../viewer/sketch.js";
import { toast } from "../panels/toast.js";
import { view } from "../viewer/fold_view.js";
import { get } from "../lib/text.js";

/**
 * What the page holds: texts of messages, and pages and scripts of others.
 * @typedef {object} Parts
 * @property {string} bundle
 * @property {string} batch
 * @property {string | null} curves
 * @property {string | null} forces
 * @property {string | null} client
 * @property {string | null} view address of the client, where pages share it
 * @property {Facts} facts
 */

/** @type {Parts} */
const parts = JSON.parse(get("parts").textContent);

/**
 * @template {Message<object, object>} Told
 * @param {string} text
 * @returns {Promise<Told>}
 */
function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  return /** @type {Promise<Told>} */ (/** @type {unknown} */ (decode(bytes.buffer)));
}

// A timeline of one batch.
/** @type {TimelineSource} */
const source = {
  bundle: () => unpacked(parts.bundle),
  batch: () => unpacked(parts.batch),
};

// Curves only; what is told of single modules would make the file many times as long, but for what a
// fold on a table asks of its joints.
class StoredFigures extends Figures {
  lacking = "not available in a downloaded page";

  /**
   * @template {Message<object, Record<string, Column>>} [Told=Message<PlotHeader, Record<PlotName, Floats>>]
   * @param {string} query
   * @returns {Promise<Told | null>}
   */
  async get(query) {
    if (query || !parts.curves) return null;
    /** @type {Promise<FigurePart | null>} */
    const forces = parts.forces ? unpacked(parts.forces) : Promise.resolve(null);
    const told = await forces;
    if (told) this.parts.set(0, told);
    return unpacked(parts.curves);
  }

  /**
   * @param {number} frame
   * @returns {FigureRow | null}
   */
  row(frame) {
    if (!this.parts.size || !this.plots) return null;
    this.plots.rows = this.plots.frames; // one part holds all frames
    return super.row(frame);
  }
}

Sketch.script = URL.createObjectURL(new Blob([window.foldbackScripts.worker], { type: "text/javascript" }));
/** @param {HTMLIFrameElement} frame */
function load(frame) {
  if (parts.view) frame.src = parts.view; else frame.srcdoc = parts.client ?? "";
}
const figures = new StoredFigures("");
const drawer = new Drawer(toast);
drawer.facts(parts.facts);
view({ source, figures, details: { drawer, ModulePanel, Plots }, load });
figures.begin();
