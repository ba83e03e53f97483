// A standalone fold: the page contains everything that it needs.
import { decode } from "../lib/columns.js";
import { Checking } from "../panels/plan_check.js";
import { Drawer } from "../panels/drawer.js";
import { ModulePanel } from "../panels/module_panel.js";
import { Plan } from "../check/plan.js";
import { Plots } from "../panels/plots.js";
import { Figures } from "../player/figures.js";
import { Sketch } from "../viewer/sketch.js";
import { thereAndBack } from "../player/frames.js";
import { view } from "../viewer/fold_view.js";
import { load } from "../viewer/scene.js";
import { get } from "../lib/text.js";

/**
 * Content of the page: encoded messages, and the 3D client.
 * @typedef {object} Parts
 * @property {string} bundle
 * @property {string} batch
 * @property {string | null} plan a file of NumPy arrays
 * @property {string | null} curves
 * @property {string | null} forces
 * @property {string | null} client
 * @property {string | null} view address of the client, if pages share it
 * @property {Tour | null} tour
 * @property {KeptValues | null} values
 * @property {PlanStep[] | null} steps
 * @property {number | null} tightest frame with the plan's smallest clearance
 */

/** @type {Parts} */
const parts = JSON.parse(get("parts").textContent);

/** @param {string} text */
const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));

/**
 * @template {Message<object, object>} Told
 * @param {string} text
 * @returns {Promise<Told>}
 */
const unpacked = (text) =>
  /** @type {Promise<Told>} */ (/** @type {unknown} */ (decode(bytesOf(text).buffer)));

// A timeline of one batch. Angles that are also in the plan are stored only there.
/** @type {TimelineSource} */
const source = {
  bundle: () => unpacked(parts.bundle),
  async batch() {
    /** @type {Batch} */
    const batch = await unpacked(parts.batch);
    if (parts.plan && !("first" in batch.arrays || "joint_angles_rad" in batch.arrays))
      Object.assign(batch.arrays, thereAndBack(await Plan.open(bytesOf(parts.plan))));
    return batch;
  },
};

// Figures of a standalone page: the curves and, for a fold on a table, the forces. Other values of
// single modules would multiply the size of the file.
class StoredFigures extends Figures {
  /** @param {FigureName} name */
  offers(name) {
    return name in (this.parts.get(0)?.header.widths ?? {});
  }

  /**
   * @template {Message<object, Record<string, Column>>} [Told=Message<PlotHeader, Record<PlotName,
   *   Floats>>]
   * @param {string} query
   * @returns {Promise<Told | null>}
   */
  async get(query) {
    if (query || !parts.curves) return null;
    if (parts.forces) this.parts.set(0, await unpacked(parts.forces));
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

Sketch.script = URL.createObjectURL(
  new Blob([window.foldbackScripts.worker], { type: "text/javascript" }),
);
/** @param {HTMLIFrameElement} frame */
function loadView(frame) {
  if (parts.view) load(frame, parts.view);
  else frame.srcdoc = parts.client ?? "";
}
const figures = new StoredFigures("");
const drawer = new Drawer();
const { player } = view({
  source,
  figures,
  details: { drawer, ModulePanel, Plots },
  load: loadView,
  tightest: () => parts.tightest,
  guide: () => Boolean(parts.tour),
  extras: {
    tour: async () => parts.tour,
    values: async () => parts.values,
    steps: async () => parts.steps,
    id: null,
  },
});
figures.begin();
get("steps").hidden = !parts.steps;
if (parts.plan) {
  const checker = await (await fetch(import.meta.resolve("foldback/checker"))).text();
  Checking.worker = () =>
    new Worker(URL.createObjectURL(new Blob([checker], { type: "text/javascript" })));
  const checking = new Checking(player, `data:;base64,${parts.plan}`);
  get("check-plan").onclick = () => checking.begin("claim");
  get("check").hidden = false;
}
