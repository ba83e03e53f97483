// The selected module: where it belongs, its joint now, what is near it.
import { degrees, element } from "../lib/text.js";

// Two figures; what is as good as nothing is 0.
const plain = (/** @type {number} */ value) => (Math.abs(value) < 1e-6 ? "0" : String(Number(value.toPrecision(2))).replace("-", "−"));
const pitches = (/** @type {number} */ value) => `${Number(value.toFixed(3))} pitch`.replace("-", "−");

/** @typedef {ModuleTold | { index: null }} Told */

export class ModulePanel {
  /**
   * @param {HTMLElement} panel
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   * @param {() => void} opened
   */
  constructor(panel, player, figures, opened) {
    this.panel = panel;
    this.player = player;
    this.figures = figures;
    this.opened = opened;
    /** @type {number | null} */
    this.index = null;
    /** @type {Snapshot | null} */
    this.shown = null;
    /** @type {JointTold[]} */
    this.joints = [];
    this.near = element("dd");
    this.off = element("dd");
    player.on("module", (/** @type {Told} */ module) => this.show(module));
    figures.on("loaded", () => this.measure());
    figures.on("begun", () => this.measure());
    this.show({ index: null });
  }

  /** @param {Told} module */
  show(module) {
    const before = this.index;
    this.index = module.index;
    if (module.index === null) {
      this.panel.replaceChildren(element("p", { class: "hint" }, "Click a module to see its joint."));
      return;
    }
    if (before !== module.index) { this.build(module); this.opened(); }
    this.fill(module);
    this.measure();
  }

  /** @param {ModuleTold} module */
  build(module) {
    const go = (/** @type {number | null} */ next) => () => this.player.send({ do: "select", module: next });
    const step = (/** @type {number} */ by, /** @type {string} */ text) => {
      const next = module.index + by;
      const button = element("button", { class: "button", type: "button", disabled: next < 0 || next >= module.modules }, text);
      button.onclick = go(next);
      return button;
    };
    const clear = element("button", { class: "button quiet", type: "button" }, "Clear");
    clear.onclick = go(null);
    const column = (/** @type {string} */ of) => element("td", { "data-of": of });
    const table = (/** @type {Node[]} */ ...parts) => element("table", { class: "joints" }, ...parts);
    const joint = module.joints.length
      ? element("div", {}, table(
        element("thead", {}, element("tr", {},
          ...["Hinge", "Now", "Folded", "Error, rad"].map((text) => element("th", { scope: "col" }, text)))),
        element("tbody", {}, ...module.joints.map(({ name }) =>
          element("tr", { "data-joint": name }, element("th", { scope: "row" }, name.split("_").slice(2).join(" ") || name),
            column("now"), column("target"), column("error"))))), table(
        element("thead", {}, element("tr", {},
          ...["Hinge", "Speed, rad/s", "Torque, N·m"].map((text) => element("th", { scope: "col" }, text)))),
        element("tbody", {}, ...module.joints.map(({ name }) =>
          element("tr", { "data-motion": name }, element("th", { scope: "row" }, name.split("_").slice(2).join(" ") || name),
            column("speed"), column("torque"))))))
      : element("p", { class: "hint no-joint" }, "This module carries no joint.");
    /** @type {Record<number, string>} */
    const ends = { 0: " · first", [module.modules - 1]: " · last" };
    this.near = element("dd", { "data-of": "nearest" }, "–");
    this.off = element("dd", { "data-of": "position" }, "–");
    this.panel.replaceChildren(
      element("h2", {}, element("i", { class: "swatch", "aria-hidden": "true" }), `Module ${module.index}${ends[module.index] ?? ""}`),
      element("dl", { class: "rows" },
        element("dt", {}, "Place in the chain"), element("dd", {}, `${module.index + 1} of ${module.modules}`),
        ...(module.cell ? [element("dt", {}, "Cell when folded"), element("dd", {}, module.cell.join(", ").replaceAll("-", "−"))] : []),
        element("dt", {}, "Nearest module"), this.near,
        element("dt", {}, "Position error"), this.off),
      element("h3", {}, "Joint"),
      joint,
      element("div", { class: "steppers" }, step(-1, "Previous"), step(1, "Next"), clear));
  }

  /** @param {ModuleTold} module */
  fill(module) {
    this.shown = module.shown;
    const speeds = this.player.timeline.speeds(module.shown.frame);
    for (const { name, column, angle_rad: angle, target_rad: target, error_rad: error } of module.joints) {
      this.put(`[data-joint="${name}"]`, "now", degrees(angle));
      this.put(`[data-joint="${name}"]`, "target", degrees(target, 0));
      this.put(`[data-joint="${name}"]`, "error", error === null ? "–" : plain(error));
      this.put(`[data-motion="${name}"]`, "speed", Number.isNaN(speeds[column]) ? "–" : plain(speeds[column]));
    }
    this.joints = module.joints;
  }

  // What is only there when the fold has been measured.
  measure() {
    if (this.index === null || !this.shown) return;
    const row = this.figures.row(this.shown.low);
    if (!row) return;
    for (const { name, column } of this.joints) {
      const torque = row.torque?.[column] ?? NaN;
      this.put(`[data-motion="${name}"]`, "torque", Number.isFinite(torque) ? plain(torque) : "–");
    }
    if (row.nearest && row.clearance) this.showNearest(row.nearest[this.index], row.clearance[this.index]);
    const off = row.position_error?.[this.index] ?? NaN;
    this.off.textContent = Number.isFinite(off) ? `${Number(off.toPrecision(2))} pitch` : "–";
  }

  /**
   * @param {number} nearest
   * @param {number} clearance
   */
  showNearest(nearest, clearance) {
    if (nearest < 0) { this.near.replaceChildren("none within a pitch"); return; }
    const link = element("button", { class: "inline", type: "button" }, `Module ${nearest}`);
    link.onclick = () => this.player.send({ do: "select", module: nearest });
    this.near.replaceChildren(link, clearance < 0 ? `, overlaps by ${pitches(-clearance)}` : `, ${pitches(clearance)} away`);
  }

  /**
   * @param {string} row
   * @param {string} of
   * @param {string} text
   */
  put(row, of, text) {
    const cell = this.panel.querySelector(`${row} [data-of="${of}"]`);
    if (cell) cell.textContent = text;
  }
}
