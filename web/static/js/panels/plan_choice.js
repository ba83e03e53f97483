// Plan choice: the candidate plans of a fold, as a scatter plot.
import { round, rule, scaleOf, ticks } from "../lib/plot.js";
import { button, element, get, newtonMetres, svg } from "../lib/text.js";

const WIDE = 336;
const HIGH = 220;
const INSET = { left: 64, right: 14, top: 18, bottom: 34 };
const SPARE = 0.08; // fraction of the span, so that no dot lies on the edge
const NEAR = { x: 26, y: 12 }; // closer dots share a label, because their labels would overlap
/**
 * @typedef {"torque_mnm" | "room" | "moving"} Axis
 * @typedef {{ at: number, text: string }} Tick
 * @typedef {{ x: number, y: number, plan: PlanDot }} Dot
 */

/**
 * @type {Record<Axis, { name: string, label: (seconds: number, columns: string[]) => string,
 *   text: (value: number) => string, log: boolean }>}
 */
const AXES = {
  torque_mnm: {
    name: "Torque",
    label: (seconds) => `Torque at a folding time of ${round(seconds)} s`,
    text: (value) => newtonMetres(value / 1000),
    log: true,
  },
  room: {
    name: "Clearance",
    label: (_, columns) => columns.at(-2) ?? "",
    text: String,
    log: false,
  },
  moving: {
    name: "Hinges at once",
    label: () => "Mean number of hinges that move at once",
    text: String,
    log: false,
  },
};

/** @type {Record<string, Axis>} */
const FIRST_AXIS = { clearance: "room", calm: "moving" }; // by preference

// Return the scale from values to positions, and its ticks.
/**
 * @param {number[]} values
 * @param {[number, number]} places
 * @param {boolean} log
 */
function scale(values, places, log) {
  const of = log ? Math.log10 : (/** @type {number} */ value) => value;
  const inverse = (/** @type {number} */ value) => (log ? 10 ** value : value);
  const [low, high] = [Math.min(...values), Math.max(...values)].map(of);
  const spare = SPARE * (high - low) || Math.abs(high) * SPARE || 1;
  const ends = /** @type {[number, number]} */ ([low - spare, high + spare].map(inverse));
  const at = scaleOf(ends, places, log);
  return { at, ticks: ticks(...ends, log).map((value) => ({ at: at(value), value })) };
}

// Return the positions of dots and ticks; only plans with both values have a dot.
/**
 * @param {PlanDot[]} plans
 * @param {Axis} axis
 * @returns {{ dots: Dot[], across: Tick[], up: Tick[] }}
 */
export function layout(plans, axis) {
  const points = plans.flatMap((plan) => {
    const [time, value] = [plan.time_s, plan[axis]];
    const { log } = AXES[axis];
    return time === null || value === null || (log && value <= 0) ? [] : [{ plan, time, value }];
  });
  if (!points.length) return { dots: [], across: [], up: [] };
  const x = scale(
    points.map(({ time }) => time),
    [INSET.left, WIDE - INSET.right],
    false,
  );
  const y = scale(
    points.map(({ value }) => value),
    [HIGH - INSET.bottom, INSET.top],
    AXES[axis].log,
  );
  return {
    dots: points.map(({ plan, time, value }) => ({ x: x.at(time), y: y.at(value), plan })),
    across: x.ticks.map(({ at, value }) => ({ at, text: String(value) })),
    up: y.ticks.map(({ at, value }) => ({ at, text: AXES[axis].text(value) })),
  };
}

// Return the labels with plan numbers; dots that are close together share one.
/** @param {Dot[]} dots */
export function labels(dots) {
  /** @type {{ x: number, y: number, text: string }[]} */
  const texts = [];
  for (const { x, y, plan } of dots) {
    const number = plan.label.split(".")[0];
    const near = texts.find(
      (label) => Math.abs(label.x - x) < NEAR.x && Math.abs(label.y - y) < NEAR.y,
    );
    if (near) {
      near.text += `, ${number}`;
      near.x = Math.max(near.x, x);
    } else texts.push({ x, y, text: number });
  }
  return texts;
}

const endOf = (/** @type {PlanDot} */ { chosen, verified }) =>
  chosen ? "chosen" : verified ? "verified" : "refused";

/**
 * @param {Choice} choice
 * @param {Axis} axis
 */
function picture({ plans, seconds, columns }, axis) {
  const { dots, across, up } = layout(plans, axis);
  const [bottom, right] = [HIGH - INSET.bottom, WIDE - INSET.right];
  const text = (
    /** @type {number} */ x,
    /** @type {number} */ y,
    /** @type {"start" | "middle" | "end"} */ anchor,
    /** @type {string} */ words,
  ) => svg("text", { x, y, "text-anchor": anchor }, words);
  const drawn = svg(
    "svg",
    {
      viewBox: `0 0 ${WIDE} ${HIGH}`,
      role: "img",
      "aria-label":
        `${columns[1]} and ${AXES[axis].name.toLowerCase()} of ${dots.length} plans. ` +
        `The table below lists the same values.`,
    },
    ...across.flatMap((tick) => [
      rule("choice-grid", { x: tick.at }, [INSET.top, bottom]),
      text(tick.at, bottom + 13, "middle", tick.text),
    ]),
    ...up.flatMap((tick) => [
      rule("choice-grid", { y: tick.at }, [INSET.left, right]),
      text(INSET.left - 5, tick.at + 4, "end", tick.text),
    ]),
    text(right, HIGH - 4, "end", columns[1]),
    // The chosen plan is drawn last, above the others.
    ...dots
      .toSorted((a, b) => Number(a.plan.chosen) - Number(b.plan.chosen))
      .map(({ x, y, plan }) =>
        svg(
          "circle",
          { class: `choice-dot ${endOf(plan)}`, cx: x, cy: y, r: plan.chosen ? 7 : 5 },
          svg("title", {}, plan.label),
        ),
      ),
    ...labels(dots).map((label) =>
      text(
        Math.min(label.x, right),
        label.y - 10,
        label.x > WIDE / 2 ? "end" : "start",
        label.text,
      ),
    ),
  );
  return [element("p", { class: "choice-axis" }, AXES[axis].label(seconds, columns)), drawn];
}

// Draw the plans above their table on the page, and select their tab.
/**
 * @param {Choice} choice
 * @param {import("./drawer.js").Drawer} drawer
 * @param {Pick<Playing, "send">} player
 */
export function showChoice(choice, drawer, player) {
  const [chips, plot] = ["axes", "plot"].map(
    (part) => /** @type {HTMLElement} */ (get("choice").querySelector(`.choice-${part}`)),
  );
  const buttons = /** @type {Axis[]} */ (Object.keys(AXES)).map((axis) => ({
    axis,
    chip: button("chip", AXES[axis].name, () => show(axis)),
  }));
  const show = (/** @type {Axis} */ axis) => {
    plot.replaceChildren(...picture(choice, axis));
    for (const item of buttons) item.chip.setAttribute("aria-pressed", String(item.axis === axis));
  };
  chips.append(...buttons.map(({ chip }) => chip));
  show(FIRST_AXIS[choice.prefer] ?? "torque_mnm");
  /** @type {HTMLElement} */ (get("choice").querySelector("[data-play]")).onclick = () => {
    player.send({ do: "seek", frame: 0 });
    player.send({ do: "play" });
  };
  drawer.choose("attempts");
}
