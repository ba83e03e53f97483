// The panel of the selected module: its number, its
// cell, the state of its joint, and the nearest module.
import { element, get, newtonMetres, number, pitches, radians, si } from "../lib/text.js";
import { frameIn, refuse } from "../player/bar.js";
import { rowsWithHeadings } from "./drawer.js";

/**
 * @param {number} value
 * @param {number} digits
 */
export function degrees(value, digits = 1) {
  const digitsText = ((value * 180) / Math.PI).toFixed(digits);
  return `${Number(digitsText) === 0 ? (0).toFixed(digits) : digitsText}°`.replace("-", "−");
}

// Return the name of a hinge within its joint.
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
    /** @type {ModuleTold | null} */
    this.module = null;
    this.modules = 0;
    this.field = get("module-number");
    this.field.onchange = () => this.choose(false);
    this.field.oninput = () => refuse(this.field, "");
    get("module-form").onsubmit = (event) => {
      event.preventDefault();
      this.choose(true);
    };
    get("module-before").onclick = () => this.step(-1);
    get("module-after").onclick = () => this.step(1);
    get("module-clear").onclick = () => {
      this.field.focus();
      player.send({ do: "select", module: null });
    };
    panel.addEventListener("click", ({ target }) => {
      const { module } = /** @type {HTMLElement} */ (target).dataset; // set on links to modules
      if (module !== undefined) player.send({ do: "select", module: Number(module) });
    });
    panel.addEventListener("keydown", (event) => this.key(event));
    player.on("outline", (/** @type {{ modules: number }} */ { modules }) => this.count(modules));
    player.on("module", (/** @type {Told} */ module) => this.show(module));
    figures.on("loaded", () => this.fill());
    figures.on("begun", () => this.fill());
    this.show({ index: null });
  }

  get index() {
    return this.module?.index ?? null;
  }

  /** @param {Told} detail */
  show(detail) {
    const before = this.index;
    const module = detail.index === null ? null : detail;
    this.module = module;
    if (before !== detail.index || !module) this.number();
    get("no-module").hidden = Boolean(module);
    get("module").hidden = !module;
    if (!module) return;
    if (before !== module.index) {
      this.build(module);
      this.opened();
      const turned = module.joints.map(
        ({ name, angle_rad: angle }) => `${hingeOf(name)} ${degrees(angle)}`,
      );
      get("module-said").textContent = [
        `Module ${module.index + 1} of ${module.modules}`,
        ...turned,
      ].join(", ");
    }
    this.fill();
  }

  // Set the number of modules to choose from.
  /** @param {number} modules */
  count(modules) {
    this.modules = modules;
    this.field.placeholder = `1–${modules}`;
    get("last-module").dataset.module = String(modules - 1);
    this.number();
  }

  // Show the number of the selected module in the field.
  number() {
    const { index, modules } = this;
    this.field.value = index === null ? "" : String(index + 1);
    refuse(this.field, "");
    get("module-before").disabled = index === null || index === 0;
    get("module-after").disabled = !modules || index === modules - 1;
    get("module-clear").hidden = index === null;
  }

  // Select the module whose number was typed; with `asked`, report an invalid number.
  /** @param {boolean} submitted */
  choose(submitted) {
    const module = frameIn(this.field.value, this.modules);
    if (module !== null) this.player.send({ do: "select", module });
    else if (submitted) refuse(this.field, `Type a whole number from 1 to ${this.modules}.`);
  }

  // Arrow up and down step along the chain.
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

  // Open the panel and focus the field of the number.
  begin() {
    this.opened();
    this.field.focus();
    this.field.select();
  }

  /** @param {ModuleTold} module */
  build({ index, modules, cell, joints }) {
    const column = (/** @type {string} */ of) => element("td", { "data-of": of });
    const rows = (/** @type {string[]} */ ...of) =>
      joints.map(({ name }) =>
        element(
          "tr",
          { "data-joint": name },
          element("th", { scope: "row" }, hingeOf(name)),
          ...of.map(column),
        ),
      );
    get("module-joint").replaceChildren(
      ...(joints.length
        ? [
            rowsWithHeadings(
              ["Hinge", "Now", "Folded", "Joint error"],
              rows("now", "target", "error"),
            ),
            rowsWithHeadings(["Hinge", "Speed", "Torque"], rows("speed", "torque")),
          ]
        : [element("p", { class: "hint" }, "This module has no joint.")]),
    );
    get("module-heading").textContent = `Module ${index + 1} of ${modules}`;
    this.write("end", index === 0 ? "first module" : index === modules - 1 ? "last module" : null);
    this.write("index", String(index));
    this.write("cell", cell && cell.join(", ").replaceAll("-", "−"));
    this.write("nearest", "–");
    this.write("position", "–");
    this.write("pressed", null);
  }

  // Write the value of a row; null hides the row.
  /**
   * @param {string} of
   * @param {string | null} text
   */
  write(of, text) {
    const value = /** @type {HTMLElement} */ (this.panel.querySelector(`dd[data-of=${of}]`));
    value.textContent = text;
    for (const part of [value, /** @type {HTMLElement} */ (value.previousElementSibling)])
      part.hidden = text === null;
    return value;
  }

  // Write the values that change with the frame. The figures of a finished fold have most of them.
  fill() {
    if (!this.module) return;
    const { index, joints, snapshot } = this.module;
    const speeds = this.player.timeline.speeds(snapshot.frame);
    const row = this.figures.row(snapshot.low);
    const unit = this.figures.plots?.table?.unit_nm ?? NaN;
    const unknown = this.figures.pending ? "…" : "–";
    for (const { name, column, angle_rad: angle, target_rad: target, error_rad: error } of joints) {
      const torque = row?.torque?.[column] ?? (row?.joint_torque?.[column] ?? NaN) * unit;
      /** @type {Record<string, string>} */
      const texts = {
        now: degrees(angle),
        target: degrees(target, 0),
        error: error === null ? "–" : radians(error),
        speed: Number.isNaN(speeds[column]) ? "–" : si(speeds[column], "rad/s"),
        torque: Number.isFinite(torque) ? newtonMetres(torque) : unknown,
      };
      const cells = /** @type {NodeListOf<HTMLElement>} */ (
        this.panel.querySelectorAll(`[data-joint="${name}"] [data-of]`)
      );
      for (const cell of cells) cell.textContent = texts[cell.dataset.of ?? ""];
    }
    if (!row) return;
    const [pressed, off] = [row.pressed?.[index] ?? null, row.position_error?.[index] ?? NaN];
    this.write(
      "pressed",
      pressed === null
        ? null
        : Number.isFinite(pressed)
          ? `${number(pressed)} × the module’s weight`
          : "–",
    );
    this.write("position", Number.isFinite(off) ? pitches(off) : "–");
    if (row.nearest && row.clearance) this.showNearest(row.nearest[index], row.clearance[index]);
  }

  /**
   * @param {number} nearest
   * @param {number} clearance
   */
  showNearest(nearest, clearance) {
    const value = this.write("nearest", "none within one spacing");
    if (nearest < 0) return;
    value.replaceChildren(
      element(
        "button",
        { class: "inline", type: "button", "data-module": nearest },
        `Module ${nearest + 1}`,
      ),
      clearance < 0 ? `, overlaps by ${pitches(-clearance)}` : `, ${pitches(clearance)} away`,
    );
  }
}
