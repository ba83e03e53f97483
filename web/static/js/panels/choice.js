// The plans that a fold with a wish had to choose from: a scatter plot, and the same as a table.
import { element, get, newtonMetres } from "../lib/text.js";
import { round, ticks } from "../lib/ticks.js";

const SVG = "http://www.w3.org/2000/svg";
const WIDE = 336;
const HIGH = 220;
const INSET = { left: 64, right: 14, top: 18, bottom: 34 };
const SPARE = 0.08; // of the span, so that no dot lies on the edge
const NEAR = { x: 26, y: 12 }; // dots nearer than this share one label, which would be on another
/**
 * @typedef {"torque_mnm" | "room"} Axis
 * @typedef {{ at: number, text: string }} Tick
 * @typedef {{ x: number, y: number, plan: PlanDot }} Dot
 */

/** @type {Record<Axis, { name: string, label: (seconds: number) => string, text: (value: number) => string, log: boolean }>} */
const AXES = {
  torque_mnm: { name: "Torque", label: (seconds) => `Torque at a folding time of ${round(seconds)} s`, text: (value) => newtonMetres(value / 1000), log: true },
  room: { name: "Clearance", label: () => "Clearance, pitch", text: String, log: false },
};

// Where a value lies between two places, and round values on the way.
/**
 * @param {number[]} values
 * @param {[number, number]} places
 * @param {boolean} log
 */
function scale(values, places, log) {
  const of = log ? Math.log10 : (/** @type {number} */ value) => value;
  const back = (/** @type {number} */ value) => (log ? 10 ** value : value);
  const [low, high] = [Math.min(...values), Math.max(...values)].map(of);
  const spare = SPARE * (high - low) || Math.abs(high) * SPARE || 1;
  const [from, to] = [low - spare, high + spare];
  const at = (/** @type {number} */ value) => places[0] + ((of(value) - from) / (to - from)) * (places[1] - places[0]);
  return { at, ticks: ticks(back(from), back(to), log).map((value) => ({ at: at(value), value })) };
}

// Where dots and ticks are; only plans that have both figures have a dot.
/**
 * @param {PlanDot[]} plans
 * @param {Axis} axis
 * @returns {{ dots: Dot[], across: Tick[], up: Tick[] }}
 */
export function layout(plans, axis) {
  const known = plans.flatMap((plan) => {
    const [time, value] = [plan.time_s, plan[axis]];
    const { log } = AXES[axis];
    return time === null || value === null || (log && value <= 0) ? [] : [{ plan, time, value }];
  });
  if (!known.length) return { dots: [], across: [], up: [] };
  const x = scale(known.map(({ time }) => time), [INSET.left, WIDE - INSET.right], false);
  const y = scale(known.map(({ value }) => value), [HIGH - INSET.bottom, INSET.top], AXES[axis].log);
  return {
    dots: known.map(({ plan, time, value }) => ({ x: x.at(time), y: y.at(value), plan })),
    across: x.ticks.map(({ at, value }) => ({ at, text: String(value) })),
    up: y.ticks.map(({ at, value }) => ({ at, text: AXES[axis].text(value) })),
  };
}

// The numbers of plans, those of dots that lie close together in one label beside the first.
/** @param {Dot[]} dots */
export function labels(dots) {
  /** @type {{ x: number, y: number, text: string }[]} */
  const found = [];
  for (const { x, y, plan } of dots) {
    const number = plan.label.split(".")[0];
    const near = found.find((label) => Math.abs(label.x - x) < NEAR.x && Math.abs(label.y - y) < NEAR.y);
    if (near) { near.text += `, ${number}`; near.x = Math.max(near.x, x); } else found.push({ x, y, text: number });
  }
  return found;
}

/**
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {string} text
 */
function svg(name, attributes, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  made.textContent = text;
  return made;
}

/**
 * @param {Choice} choice
 * @param {Axis} axis
 */
function picture({ plans, seconds }, axis) {
  const { dots, across, up } = layout(plans, axis);
  const said = AXES[axis].label(seconds);
  const drawn = svg("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": `Folding time and ${AXES[axis].name.toLowerCase()} of ${dots.length} plans. The table below lists the same values.` });
  const bottom = HIGH - INSET.bottom;
  for (const { at, text } of across) {
    drawn.append(svg("line", { class: "choice-grid", x1: at, x2: at, y1: INSET.top, y2: bottom }),
      svg("text", { x: at, y: bottom + 13, "text-anchor": "middle" }, text));
  }
  for (const { at, text } of up) {
    drawn.append(svg("line", { class: "choice-grid", x1: INSET.left, x2: WIDE - INSET.right, y1: at, y2: at }),
      svg("text", { x: INSET.left - 5, y: at + 4, "text-anchor": "end" }, text));
  }
  drawn.append(svg("text", { x: WIDE - INSET.right, y: HIGH - 4, "text-anchor": "end" }, "Folding time, s"));
  // The chosen one last, over the others.
  for (const { x, y, plan } of dots.sort((a, b) => Number(a.plan.chosen) - Number(b.plan.chosen))) {
    const kind = plan.chosen ? "chosen" : plan.verified ? "verified" : "refused";
    const dot = svg("circle", { class: `choice-dot ${kind}`, cx: x, cy: y, r: plan.chosen ? 7 : 5 });
    dot.append(svg("title", {}, plan.label));
    drawn.append(dot);
  }
  for (const { x, y, text } of labels(layout(plans, axis).dots)) {
    drawn.append(svg("text", { x: Math.min(x, WIDE - INSET.right), y: y - 10, "text-anchor": x > WIDE / 2 ? "end" : "start" }, text));
  }
  return [element("p", { class: "choice-axis" }, said), drawn];
}

/**
 * @param {Choice} choice
 * @param {() => void} play
 */
function table({ plans, columns }, play) {
  const playing = () => {
    const button = element("button", { class: "inline", type: "button" }, "Play this plan");
    button.onclick = play;
    return button;
  };
  const ends = (/** @type {PlanDot} */ { chosen, verified }) => (chosen ? "chosen" : verified ? "verified" : "refused");
  return element("div", { class: "choice-table" }, element("table", { class: "joints" },
    element("thead", {}, element("tr", {}, ...columns.map((text) => element("th", { scope: "col" }, text)))),
    element("tbody", {}, ...plans.map((plan) => element("tr", { "data-end": ends(plan) },
      element("th", { scope: "row" }, plan.label, element("small", {}, ends(plan)), plan.chosen ? playing() : null),
      ...plan.cells.map((text) => element("td", {}, text)))))));
}

// Shows it in its tab, which is then the first to be seen.
/**
 * @param {Choice} choice
 * @param {import("./drawer.js").Drawer} drawer
 * @param {Pick<Playing, "send">} player
 */
export function showChoice(choice, drawer, player) {
  const plot = element("figure", { class: "choice-plot" });
  const buttons = /** @type {Axis[]} */ (Object.keys(AXES)).map((axis) => {
    const button = element("button", { class: "chip", type: "button" }, AXES[axis].name);
    button.onclick = () => show(axis);
    return { axis, button };
  });
  const show = (/** @type {Axis} */ axis) => {
    plot.replaceChildren(...picture(choice, axis));
    for (const each of buttons) each.button.setAttribute("aria-pressed", String(each.axis === axis));
  };
  show(choice.prefer === "clearance" ? "room" : "torque_mnm");
  get("choice").replaceChildren(element("h2", {}, `${choice.wish}: ${choice.plans.length} plans`),
    element("p", {}, choice.text),
    element("div", { class: "choice-axes", role: "group", "aria-label": "Vertical axis" }, ...buttons.map(({ button }) => button)),
    plot, table(choice, () => { player.send({ do: "seek", frame: 0 }); player.send({ do: "play" }); }),
    ...(choice.plans.length > 1 ? [element("p", { class: "hint" }, "Only the chosen plan is stored and can be played. The others have only these figures.")] : []));
  drawer.choose("attempts");
}
