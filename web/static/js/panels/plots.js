// Plots of figures over the whole fold, with the playhead; clicks and keys move it.
import { linePath, moveRule, rule, scaleOf, ticks } from "../lib/plot.js";
import {
  button,
  element,
  newtonMetres,
  number,
  pitches,
  radians,
  save,
  seconds,
  svg,
  integerText,
} from "../lib/text.js";
import { shareAt } from "../player/bar.js";

const COLUMNS = 360;
const WIDE = 1000;
const HIGH = 100;
const TICKS = { up: 5, across: 4 }; // approximate numbers
const HEADROOM = 1.06; // height of a plot, as a multiple of its highest value or bound
const FAR = 10; // frames
/**
 * @typedef {object} Plot
 * @property {PlotName} name
 * @property {(value: number) => string} text
 * @property {(...values: number[]) => number} worst
 * @property {{ at: number, meaning: string }[]} [bounds] lines across it, lowest first
 * @property {string} [suffix] beside its scale
 */

/** @type {Plot[]} */
const PLOTS = [
  { name: "max_error_rad", text: radians, worst: Math.max },
  {
    name: "min_clearance",
    text: pitches,
    worst: Math.min,
    suffix: "of the motion that you see; the verdict is about the planned motion",
  },
  { name: "hinges_moving", text: integerText, worst: Math.max },
  { name: "peak_torque_nm", text: newtonMetres, worst: Math.max },
];
const TORQUES = ["table_torque", "peak_torque_nm"]; // a fold has one of them

// Return the plot of the largest torque on a table, with its limits.
/**
 * @param {TableBounds | null | undefined} table
 * @returns {Plot[]}
 */
function onTable(table) {
  if (!table) return [];
  const wp = (/** @type {number} */ v) => `${number(v)} w·p`;
  const bounds = [
    { at: table.kept, meaning: "limit while unfolding" },
    { at: table.bound, meaning: "limit" },
  ];
  return [
    {
      name: "table_torque",
      text: (v) => `${wp(v)} (${newtonMetres(v * table.unit_nm)})`,
      worst: Math.max,
      bounds: bounds.flatMap(({ at, meaning }) =>
        at === null ? [] : [{ at, meaning: `${wp(at)} ${meaning}` }],
      ),
      suffix: table.words,
    },
  ];
}

const SOME_FRAMES =
  "computed from the motion, but only at some frames; straight lines connect the values";
// The certificate has the peak motor torque over all
// steps, which inverse dynamics of frames cannot give.
const ALL_FRAMES =
  "computed from the motion of the plan; for the highest torque in the simulation, see Peak " +
  "torque in Properties";

// Return the worst value in each of a few hundred columns; NaN if there is none.
/**
 * @param {Floats} values
 * @param {Plot["worst"]} worst
 */
function columns(values, worst) {
  const count = Math.min(COLUMNS, values.length);
  return Array.from({ length: count }, (_, k) => {
    const [start, end] = [k, k + 1].map((column) => Math.floor((column * values.length) / count));
    const finite = Array.from(values.subarray(start, end)).filter(Number.isFinite);
    return finite.length ? finite.reduce((a, b) => worst(a, b)) : NaN;
  });
}

// Return the ticks of a plot, as fractions of its height (from below) and of its width.
/**
 * @param {{ low: number, high: number, frames: number, text: (value: number) => string }} plot
 */
export function axes({ low, high, frames, text }) {
  const span = high - low || 1;
  const up = ticks(low, low + span, false, TICKS.up).map((value) => ({
    at: (value - low) / span,
    text: text(value),
  }));
  const inner = ticks(1, Math.max(frames, 2), false, TICKS.across).filter(
    (frame) => Number.isInteger(frame) && frame > 1 && frame <= frames,
  );
  const across = [1, ...inner].map((frame) => ({
    at: (frame - 1) / Math.max(1, frames - 1),
    text: integerText(frame),
  }));
  return { up: up.filter(({ text: label }, k) => label !== up[k - 1]?.text), across };
}

// Return a plot as CSV: each frame and its value, empty if there is none.
/**
 * @param {string} name
 * @param {Floats} values
 */
export const csv = (name, values) =>
  [
    `frame,${name}`,
    ...Array.from(values, (v, k) => `${k + 1},${Number.isFinite(v) ? v : ""}`),
  ].join("\n");

// Return a picture with its axes: values at the left, frames below.
/**
 * @param {SVGElement} picture
 * @param {ReturnType<typeof axes>} marks
 */
function framed(picture, { up, across }) {
  const labels = (
    /** @type {"bottom" | "left"} */ side,
    /** @type {{ at: number, text: string }[]} */ list,
  ) =>
    list.map(({ at, text }) => {
      const label = element("span", {}, text);
      label.style[side] = `${100 * at}%`;
      return label;
    });
  return element(
    "div",
    { class: "plot-framed" },
    element("div", { class: "plot-up", "aria-hidden": "true" }, ...labels("bottom", up)),
    picture,
    element("div", { class: "plot-across", "aria-hidden": "true" }, ...labels("left", across)),
    element("span", { class: "plot-unit", "aria-hidden": "true" }, "Frame"),
  );
}

/** @typedef {NonNullable<ReturnType<Plots["plot"]>>} Made */

export class Plots {
  /**
   * @param {HTMLElement} panel
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   */
  constructor(panel, player, figures) {
    this.panel = panel;
    /** @type {Record<PlotName, string>} */
    this.labels = JSON.parse(panel.dataset.labels ?? "{}");
    this.player = player;
    this.figures = figures;
    /** @type {Made[]} */
    this.drawnPlots = [];
    const hint = element("p", { class: "hint" }, "Plots appear when the fold is finished.");
    panel.replaceChildren(hint);
    figures.on("begun", () => this.build());
    figures.on("computing", () => {
      if (!figures.plots) hint.textContent = "Computing the plots…";
    });
    figures.on("missing", () => {
      if (!figures.plots) hint.textContent = "There are no plots for this plan.";
    });
    player.on("state", (/** @type {State} */ state) => this.show(state));
  }

  build() {
    const { plots } = this.figures;
    if (!plots) return;
    this.drawnPlots = [...onTable(plots.table), ...PLOTS].flatMap((plot) => {
      const values = plots[plot.name];
      const drawn = values ? this.plot(plot, values) : null;
      return drawn ? [drawn] : [];
    });
    this.panel.replaceChildren(...this.drawnPlots.map(({ box }) => box));
    if (this.player.snapshot) this.show({ frame: this.player.playhead.frame });
  }

  /**
   * @param {Plot} plot
   * @param {Floats} values
   */
  plot(plot, values) {
    const { name, text, worst, bounds = [] } = plot;
    const label = this.labels[name];
    const drawn = columns(values, worst);
    const finite = drawn.filter(Number.isFinite);
    if (!finite.length) return null;
    const high = HEADROOM * Math.max(...finite, ...bounds.map(({ at }) => at), 0);
    const low = HEADROOM * Math.min(...finite, 0);
    const y = scaleOf([low, high], [HIGH, 0]);
    const [line, hair] = [
      rule("plot-head", { x: 0 }, [0, HIGH]),
      rule("plot-hair", { x: 0 }, [0, HIGH]),
    ];
    hair.setAttribute("visibility", "hidden");
    const marks = axes({ low, high, frames: values.length, text });
    const picture = svg(
      "svg",
      {
        viewBox: `0 0 ${WIDE} ${HIGH}`,
        preserveAspectRatio: "none",
        role: "slider",
        tabindex: 0,
        "aria-label": label,
        "aria-valuemin": 1,
        "aria-valuemax": values.length,
      },
      ...marks.up.map(({ at }) => rule("plot-grid", { y: HIGH * (1 - at) }, [0, WIDE])),
      ...(low < 0
        ? [svg("rect", { class: "plot-bad", x: 0, width: WIDE, y: y(0), height: HIGH - y(0) })]
        : []),
      rule("plot-zero", { y: y(0) }, [0, WIDE]),
      svg("path", {
        class: "plot-line",
        d: linePath(drawn, (k) => (WIDE * (k + 0.5)) / drawn.length, y),
      }),
      line,
      ...bounds.map(({ at }) => rule("plot-bound", { y: y(at) }, [0, WIDE])),
      hair,
    );
    const [now, position] = [element("b"), element("small", { class: "plot-where" })];
    const larger = button("inline", "Larger", () => this.enlarge(box, larger), {
      "aria-label": `Larger view of ${label.toLowerCase()}`,
    });
    const sheet = button(
      "inline",
      "CSV",
      () => save(new Blob([csv(plot.name, values)], { type: "text/csv" }), `${plot.name}.csv`),
      { "aria-label": `${label} as CSV`, title: "Every frame and its value" },
    );
    const box = element(
      "figure",
      { class: "plot" },
      element("figcaption", {}, element("span", {}, label), now, position),
      framed(picture, marks),
      element(
        "div",
        { class: "plot-foot" },
        element("small", {}, this.scaleWords(plot, finite)),
        larger,
        sheet,
      ),
      button("icon-button dialog-close plot-close", "×", () => box.hidePopover(), {
        "aria-label": "Close",
        title: "Close",
      }),
      bounds.length
        ? element(
            "small",
            { class: "plot-bounds" },
            element("i", { "aria-hidden": "true" }),
            bounds.map(({ meaning }) => meaning).join("; "),
          )
        : null,
    );
    const drawnPlot = { box, values, text, now, where: position, line, hair, label, picture };
    this.listen(drawnPlot);
    return drawnPlot;
  }

  // Return the text beside a plot: its range and the origin of its values.
  /**
   * @param {Plot} plot
   * @param {number[]} finite
   */
  scaleWords({ name, text, suffix = "" }, finite) {
    const origin = this.figures.plots?.torque_at_some_frames ? SOME_FRAMES : ALL_FRAMES;
    return [
      `${text(Math.min(...finite, 0))} to ${text(Math.max(...finite, 0))}`,
      suffix,
      name === "peak_torque_nm" ? origin : "",
    ]
      .filter(Boolean)
      .join(", ");
  }

  // Show the value under the pointer; a press goes to its frame.
  /** @param {Made} plot */
  listen(plot) {
    const { picture, values } = plot;
    const frameAt = (/** @type {MouseEvent} */ event) =>
      Math.round(Math.min(1, Math.max(0, shareAt(event.clientX, picture))) * (values.length - 1));
    const go = (/** @type {MouseEvent} */ event) =>
      this.player.send({ do: "seek", frame: frameAt(event) });
    picture.addEventListener("pointerdown", (event) => {
      picture.setPointerCapture(event.pointerId);
      go(event);
    });
    picture.addEventListener("pointermove", (event) => {
      this.point(plot, frameAt(event));
      if (event.buttons) go(event);
    });
    picture.addEventListener("pointerleave", () => this.point(plot, null));
    picture.addEventListener("keydown", (event) => this.key(event));
  }

  // Show the value at the pointer instead of that at the playhead; null after the pointer has left.
  /**
   * @param {Made} plot
   * @param {number | null} frame
   */
  point(plot, frame) {
    plot.hair.setAttribute("visibility", frame === null ? "hidden" : "visible");
    const last = plot.values.length - 1;
    const shownFrame = frame ?? Math.min(last, Math.round(this.player.playhead.frame));
    moveRule(plot.hair, (WIDE * shownFrame) / Math.max(1, last));
    this.read(plot, shownFrame);
  }

  // Show the value at a frame and its time.
  /**
   * @param {Made} made
   * @param {number} frame
   */
  read({ values, text, now, where: position }, frame) {
    const value = values[frame];
    const time = this.player.timeline.row(frame)?.time_s;
    now.textContent = Number.isFinite(value) ? text(value) : "–";
    position.textContent = [
      `frame ${integerText(frame + 1)}`,
      time === undefined ? null : seconds(time),
    ]
      .filter(Boolean)
      .join(", ");
  }

  // Enlarge a plot over the page, or restore it.
  /**
   * @param {HTMLElement} box
   * @param {HTMLElement} larger its button
   */
  enlarge(box, larger) {
    if (box.popover) {
      box.hidePopover();
      return;
    }
    box.popover = "auto";
    box.ontoggle = ({ newState }) => {
      larger.textContent = newState === "open" ? "Close" : "Larger";
      box.classList.toggle("dialog", newState === "open");
      if (newState === "open") return;
      box.popover = null;
      larger.focus();
    };
    box.showPopover();
  }

  /** @param {{ frame: number }} state */
  show({ frame }) {
    const { frames } = this.figures.plots ?? {};
    if (!frames) return;
    const x = (WIDE * Math.min(frame, frames - 1)) / Math.max(1, frames - 1);
    const shownFrame = Math.min(frames - 1, Math.round(frame));
    for (const plot of this.drawnPlots) {
      const { values, text, line, hair, label, picture } = plot;
      moveRule(line, x);
      const value = values[shownFrame];
      const valueText = Number.isFinite(value) ? text(value) : null;
      if (hair.getAttribute("visibility") === "hidden") this.read(plot, shownFrame);
      picture.setAttribute("aria-valuenow", String(shownFrame + 1));
      picture.setAttribute(
        "aria-valuetext",
        `Frame ${shownFrame + 1}, ${label.toLowerCase()} ${valueText ?? "unknown"}`,
      );
    }
  }

  // Page keys move the playhead by ten frames; the page itself handles the other keys.
  /** @param {KeyboardEvent} event */
  key(event) {
    const by = event.key === "PageUp" ? FAR : event.key === "PageDown" ? -FAR : 0;
    if (!by || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.player.send({ do: "step", by });
  }

  // Return the frame of the fold at which a figure is worst; null if there is none. No robot
  // follows the explosion, so that its frames do not count.
  /** @param {string} name */
  worst(name) {
    const { plots } = this.figures;
    const plotName = TORQUES.includes(name)
      ? TORQUES.find((torque) => plots?.[/** @type {PlotName} */ (torque)])
      : name;
    const plot = [...onTable(plots?.table), ...PLOTS].find((p) => p.name === plotName);
    const values = plot && plots?.[plot.name];
    if (!plot || !values) return null;
    const start =
      this.player.timeline.outline?.phases.find(({ name: phase }) => phase !== "explosion")?.from ??
      0;
    const finite = Array.from(values.subarray(start)).filter(Number.isFinite);
    return finite.length
      ? values.indexOf(
          finite.reduce((a, b) => plot.worst(a, b)),
          start,
        )
      : null;
  }
}
