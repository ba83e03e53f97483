// The selected module: chosen by its number, where it belongs, its joint now, what is near it.
import { button, element, newtonMetres, number, pitches, radians, si } from "../lib/text.js";
import { frameIn, refuse } from "../player/bar.js";
import { table } from "./drawer.js";

/**
 * @param {number} value
 * @param {number} digits
 */
export function degrees(value, digits = 1) {
  const shown = ((value * 180) / Math.PI).toFixed(digits);
  return `${Number(shown) === 0 ? (0).toFixed(digits) : shown}°`.replace("-", "−");
}

// The name of a hinge within its joint.
const hingeOf = (/** @type {string} */ name) => name.split("_").slice(2).join(" ") || name;

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
    this.pressing = element("dt", { hidden: true }, "Force on the table");
    this.presses = element("dd", { "data-of": "pressed", hidden: true });
    this.modules = 0;
    this.field = element("input", { id: "module-number", type: "text", inputmode: "numeric", enterkeyhint: "go", autocomplete: "off", maxlength: 9 });
    this.before = button("icon-button", "‹", () => this.step(-1), { "aria-label": "Previous module", title: "Previous module (↓)" });
    this.after = button("icon-button", "›", () => this.step(1), { "aria-label": "Next module", title: "Next module (↑)" });
    this.clear = button("button quiet", "Clear", () => { this.field.focus(); player.send({ do: "select", module: null }); }, { hidden: true });
    this.told = element("div");
    this.line = element("p", { class: "visually-hidden", role: "status" });
    const form = element("form", { class: "module-choice", novalidate: true }, element("label", { for: "module-number" }, "Number"), this.field, this.before, this.after, this.clear);
    form.onsubmit = (event) => { event.preventDefault(); this.choose(true); };
    this.field.onchange = () => this.choose(false);
    this.field.oninput = () => refuse(this.field, "");
    panel.tabIndex = -1; // a click in it is enough for its keys
    panel.addEventListener("keydown", (event) => this.key(event));
    panel.replaceChildren(form, this.told, this.line);
    player.on("outline", (/** @type {{ modules: number }} */ { modules }) => this.count(modules));
    player.on("module", (/** @type {Told} */ module) => this.show(module));
    figures.on("loaded", () => this.measure());
    figures.on("begun", () => this.measure());
    this.show({ index: null });
  }

  /** @param {Told} module */
  show(module) {
    const before = this.index;
    this.index = module.index;
    if (before !== module.index || module.index === null) this.number();
    if (module.index === null) {
      // The ends of the chain, and how the view marks them.
      this.told.replaceChildren(element("p", { class: "hint" }, "Click a module, or type its number, to see its joint. Module numbers start at 1."),
        element("p", { class: "hint" }, "A white stud marks the ", this.link("first module", () => 0), " of the chain. A dark stud marks the ", this.link("last module", () => this.modules - 1), "."));
      return;
    }
    if (before !== module.index) {
      this.build(module);
      this.opened();
      const turned = module.joints.map(({ name, angle_rad: angle }) => `${hingeOf(name)} ${degrees(angle)}`);
      this.line.textContent = [`Module ${module.index + 1} of ${module.modules}`, ...turned].join(", ");
    }
    this.fill(module);
    this.measure();
  }

  // How many there are to choose from.
  /** @param {number} modules */
  count(modules) {
    this.modules = modules;
    this.field.placeholder = `1–${modules}`;
    this.number();
  }

  // Which one is chosen, in the field.
  number() {
    const { index, modules } = this;
    this.field.value = index === null ? "" : String(index + 1);
    refuse(this.field, "");
    this.before.disabled = index === null || index === 0;
    this.after.disabled = !modules || index === modules - 1;
    this.clear.hidden = index === null;
  }

  // The module whose number was typed; `asked` says that a wrong one is to be told.
  /** @param {boolean} asked */
  choose(asked) {
    const module = frameIn(this.field.value, this.modules);
    if (module !== null) this.player.send({ do: "select", module });
    else if (asked) refuse(this.field, `Type a whole number from 1 to ${this.modules}.`);
  }

  // Up and down go along the chain.
  /** @param {KeyboardEvent} event */
  key(event) {
    const by = event.key === "ArrowUp" ? 1 : event.key === "ArrowDown" ? -1 : 0;
    if (!by || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.step(by);
  }

  /** @param {number} by */
  step(by) {
    const next = this.index === null ? 0 : this.index + by;
    if (next >= 0 && next < this.modules) this.player.send({ do: "select", module: next });
  }

  // Leads to a module.
  /**
   * @param {string} text
   * @param {() => number} module
   */
  link(text, module) { return button("inline", text, () => this.player.send({ do: "select", module: module() })); }

  // To type a number.
  begin() {
    this.opened();
    this.field.focus();
    this.field.select();
  }

  /** @param {ModuleTold} module */
  build(module) {
    const column = (/** @type {string} */ of) => element("td", { "data-of": of });
    const rows = (/** @type {string} */ key, /** @type {string[]} */ of) => module.joints.map(({ name }) => element("tr", { [key]: name }, element("th", { scope: "row" }, hingeOf(name)), ...of.map(column)));
    const joint = module.joints.length
      ? element("div", {}, table(["Hinge", "Now", "Folded", "Error"], rows("data-joint", ["now", "target", "error"])), table(["Hinge", "Speed", "Torque"], rows("data-motion", ["speed", "torque"])))
      : element("p", { class: "hint no-joint" }, "This module has no joint.");
    /** @type {Record<number, string>} */
    const ends = { 0: "first module of the chain", [module.modules - 1]: "last module of the chain" };
    const end = ends[module.index];
    this.near = element("dd", { "data-of": "nearest" }, "–");
    this.off = element("dd", { "data-of": "position" }, "–");
    this.presses.textContent = "–";
    this.told.replaceChildren(
      element("h2", {}, element("i", { class: "swatch", "aria-hidden": "true" }), `Module ${module.index + 1} of ${module.modules}`),
      element("dl", { class: "rows" },
        ...(end ? [element("dt", {}, "End"), element("dd", {}, end)] : []),
        element("dt", {}, "Index in files (from 0)"), element("dd", { "data-of": "index" }, String(module.index)),
        ...(module.cell ? [element("dt", {}, "Cell when folded"), element("dd", {}, module.cell.join(", ").replaceAll("-", "−"))] : []),
        element("dt", {}, "Nearest module"), this.near,
        element("dt", {}, "Position error"), this.off,
        this.pressing, this.presses),
      element("h3", {}, "Joint"),
      joint);
  }

  /** @param {ModuleTold} module */
  fill(module) {
    this.shown = module.shown;
    const speeds = this.player.timeline.speeds(module.shown.frame);
    for (const { name, column, angle_rad: angle, target_rad: target, error_rad: error } of module.joints) {
      this.put(`[data-joint="${name}"]`, "now", degrees(angle));
      this.put(`[data-joint="${name}"]`, "target", degrees(target, 0));
      this.put(`[data-joint="${name}"]`, "error", error === null ? "–" : radians(error));
      this.put(`[data-motion="${name}"]`, "speed", Number.isNaN(speeds[column]) ? "–" : si(speeds[column], "rad/s"));
    }
    this.joints = module.joints;
  }

  // What is only there when the fold has been measured.
  measure() {
    if (this.index === null || !this.shown) return;
    const row = this.figures.row(this.shown.low);
    if (!row) return;
    for (const { name, column } of this.joints) {
      const unit = this.figures.plots?.table?.unit_nm ?? NaN;
      const torque = row.torque?.[column] ?? (row.joint_torque?.[column] ?? NaN) * unit;
      this.put(`[data-motion="${name}"]`, "torque", Number.isFinite(torque) ? newtonMetres(torque) : "–");
    }
    if (row.nearest && row.clearance) this.showNearest(row.nearest[this.index], row.clearance[this.index]);
    const pressed = row.pressed?.[this.index];
    for (const part of [this.presses, this.pressing]) part.hidden = pressed === undefined;
    this.presses.textContent = pressed !== undefined && Number.isFinite(pressed) ? `${number(pressed)} × its weight` : "–";
    const off = row.position_error?.[this.index] ?? NaN;
    this.off.textContent = Number.isFinite(off) ? pitches(off) : "–";
  }

  /**
   * @param {number} nearest
   * @param {number} clearance
   */
  showNearest(nearest, clearance) {
    if (nearest < 0) { this.near.replaceChildren("none within a module width"); return; }
    this.near.replaceChildren(this.link(`Module ${nearest + 1}`, () => nearest), clearance < 0 ? `, overlaps by ${pitches(-clearance)}` : `, ${pitches(clearance)} away`);
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
