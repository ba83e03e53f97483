// Figures along the whole fold, with the playhead in them; a click goes there, and keys move it.
import { element, newtonMetres, number, pitches, radians, whole } from "../lib/text.js";

const SVG = "http://www.w3.org/2000/svg";
const COLUMNS = 360;
const HIGH = 100;
const HEADROOM = 1.06; // of a plot above its highest bound
const FAR = 10; // frames
const KEPT_MS = 60_000; // what is being downloaded
/**
 * @typedef {object} Plot
 * @property {PlotName} name
 * @property {string} label
 * @property {(value: number) => string} text
 * @property {(...values: number[]) => number} worst
 * @property {{ at: number, what: string }[]} [bounds] lines across it, lowest first
 * @property {string} [said] beside its scale
 */

/** @type {Plot[]} */
const PLOTS = [
  { name: "max_error_rad", label: "Largest joint error", text: radians, worst: Math.max },
  { name: "min_clearance", label: "Least clearance", text: pitches, worst: Math.min },
  { name: "hinges_moving", label: "Hinges moving", text: whole, worst: Math.max },
  { name: "peak_torque_nm", label: "Largest torque", text: newtonMetres, worst: Math.max },
];
const TORQUES = ["table_torque", "peak_torque_nm"]; // whichever there is

// The largest torque on a table, with what was allowed.
/**
 * @param {TableBounds | null | undefined} table
 * @returns {Plot[]}
 */
function onTable(table) {
  if (!table) return [];
  const wp = (/** @type {number} */ v) => `${number(v)} w·p`;
  const bounds = [{ at: table.kept, what: "kept to while unfolding" }, { at: table.bound, what: "allowed" }];
  return [{
    name: "table_torque", label: "Largest torque on the table", text: (v) => `${wp(v)} (${newtonMetres(v * table.unit_nm)})`, worst: Math.max,
    bounds: bounds.flatMap(({ at, what }) => (at === null ? [] : [{ at, what: `${wp(at)} ${what}` }])), said: table.words,
  }];
}

const SOME_FRAMES = "looked at in some frames, straight lines between them";

/**
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 */
function svg(name, attributes = {}) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  return made;
}

// The worst value in each of a few hundred columns; NaN where there is none.
/**
 * @param {Floats} values
 * @param {Plot["worst"]} worst
 */
function columns(values, worst) {
  const count = Math.min(COLUMNS, values.length);
  return Array.from({ length: count }, (_, k) => {
    let found = NaN;
    for (let i = Math.floor((k * values.length) / count); i < Math.floor(((k + 1) * values.length) / count); i++) {
      if (Number.isFinite(values[i])) found = Number.isNaN(found) ? values[i] : worst(found, values[i]);
    }
    return found;
  });
}

// A plot as text: each frame and its value, nothing where there is none.
/**
 * @param {string} name
 * @param {Floats} values
 */
export const csv = (name, values) => [`frame,${name}`, ...Array.from(values, (v, k) => `${k + 1},${Number.isFinite(v) ? v : ""}`)].join("\n");

/**
 * @param {string} name
 * @param {string} label
 * @param {Floats} values
 */
function link(name, label, values) {
  const made = element("a", { href: "#", download: `${name}.csv`, "aria-label": `${label} as CSV`, title: "Every frame and its value" }, "CSV");
  made.onclick = () => {
    const address = URL.createObjectURL(new Blob([csv(name, values)], { type: "text/csv" }));
    made.href = address;
    setTimeout(() => URL.revokeObjectURL(address), KEPT_MS);
  };
  return made;
}

export class Plots {
  /**
   * @param {HTMLElement} panel
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   */
  constructor(panel, player, figures) {
    this.panel = panel;
    this.player = player;
    this.figures = figures;
    /** @type {NonNullable<ReturnType<Plots["plot"]>>[]} */
    this.made = [];
    const hint = document.createElement("p");
    hint.className = "hint";
    hint.textContent = "Plots come with a finished fold.";
    panel.replaceChildren(hint);
    figures.on("begun", () => this.build());
    player.on("state", (/** @type {State} */ state) => this.show(state));
  }

  build() {
    const { plots } = this.figures;
    if (!plots) return;
    this.made = [...onTable(plots.table), ...PLOTS].flatMap((plot) => {
      const values = plots[plot.name];
      const made = values ? this.plot(plot, values) : null;
      return made ? [made] : [];
    });
    this.panel.replaceChildren(...this.made.map(({ box }) => box));
    if (this.player.shown) this.show({ frame: this.player.playhead.frame });
  }

  /**
   * @param {Plot} plot
   * @param {Floats} values
   */
  plot({ name, label, text, worst, bounds = [], said = "" }, values) {
    const drawn = columns(values, worst);
    const known = drawn.filter(Number.isFinite);
    if (!known.length) return null;
    const high = Math.max(...known, ...bounds.map(({ at }) => at * HEADROOM), 0);
    const low = Math.min(...known, 0);
    const span = high - low || 1;
    const y = (/** @type {number} */ v) => HIGH - ((v - low) / span) * HIGH;
    let path = "";
    let open = false;
    drawn.forEach((v, k) => {
      if (!Number.isFinite(v)) { open = false; return; }
      path += `${open ? "L" : "M"}${((1000 * (k + 0.5)) / drawn.length).toFixed(1)} ${y(v).toFixed(1)}`;
      open = true;
    });
    const box = document.createElement("figure");
    box.className = "plot";
    const caption = document.createElement("figcaption");
    const title = document.createElement("span");
    title.textContent = label;
    const now = document.createElement("b");
    caption.append(title, now);
    const picture = svg("svg", { viewBox: `0 0 1000 ${HIGH}`, preserveAspectRatio: "none", role: "slider", tabindex: 0, "aria-label": label, "aria-valuemin": 1, "aria-valuemax": values.length });
    if (low < 0) picture.append(svg("rect", { class: "plot-bad", x: 0, width: 1000, y: y(0), height: HIGH - y(0) }));
    const line = svg("line", { class: "plot-head", y1: 0, y2: HIGH });
    picture.append(svg("line", { class: "plot-zero", x1: 0, x2: 1000, y1: y(0), y2: y(0) }), svg("path", { class: "plot-line", d: path }), line);
    for (const { at } of bounds) picture.append(svg("line", { class: "plot-bound", x1: 0, x2: 1000, y1: y(at), y2: y(at) }));
    const scale = document.createElement("small");
    scale.textContent = [`${text(Math.min(...known, 0))} to ${text(Math.max(...known, 0))}`, said].filter(Boolean).join(", ");
    if (name === "peak_torque_nm" && this.figures.plots?.torque_at_some_frames) scale.textContent += `, ${SOME_FRAMES}`;
    box.append(caption, picture, element("div", { class: "plot-foot" }, scale, link(name, label, values)));
    if (bounds.length) box.append(element("small", { class: "plot-bounds" }, element("i", { "aria-hidden": "true" }), bounds.map(({ what }) => what).join("; ")));
    const go = (/** @type {MouseEvent} */ event) => {
      const { left, width } = picture.getBoundingClientRect();
      const share = Math.min(1, Math.max(0, (event.clientX - left) / width));
      this.player.send({ do: "seek", frame: Math.round(share * (values.length - 1)) });
    };
    picture.addEventListener("pointerdown", (event) => { picture.setPointerCapture(event.pointerId); go(event); });
    picture.addEventListener("pointermove", (event) => { if (event.buttons) go(event); });
    picture.addEventListener("keydown", (event) => this.key(event));
    return { box, values, text, now, line, label, picture };
  }

  /** @param {{ frame: number }} state */
  show({ frame }) {
    const { frames } = this.figures.plots ?? {};
    if (!frames) return;
    const x = (1000 * Math.min(frame, frames - 1)) / Math.max(1, frames - 1);
    const shown = Math.min(frames - 1, Math.round(frame));
    for (const { values, text, now, line, label, picture } of this.made) {
      line.setAttribute("x1", String(x));
      line.setAttribute("x2", String(x));
      const value = values[shown];
      const told = Number.isFinite(value) ? text(value) : null;
      now.textContent = told ?? "–";
      picture.setAttribute("aria-valuenow", String(shown + 1));
      picture.setAttribute("aria-valuetext", `Frame ${shown + 1}, ${label.toLowerCase()} ${told ?? "not known"}`);
    }
  }

  // The keys of the page move a playhead by frames, and to either end; these by ten.
  /** @param {KeyboardEvent} event */
  key(event) {
    const by = event.key === "PageUp" ? FAR : event.key === "PageDown" ? -FAR : 0;
    if (!by || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.player.send({ do: "step", by });
  }

  // The frame at which a figure is worst, or null.
  /** @param {string} name */
  worst(name) {
    const { plots } = this.figures;
    const wanted = TORQUES.includes(name) ? TORQUES.find((one) => plots?.[/** @type {PlotName} */ (one)]) : name;
    const plot = [...onTable(plots?.table), ...PLOTS].find((p) => p.name === wanted);
    const values = plot && plots?.[plot.name];
    if (!plot || !values) return null;
    /** @type {number | null} */
    let at = null;
    values.forEach((v, k) => { if (Number.isFinite(v) && (at === null || plot.worst(values[at], v) !== values[at])) at = k; });
    return at;
  }
}
