// Axes and lines of plots.
import { svg } from "./text.js";

/** Approximate number of ticks of an axis. Labels of more ticks overlap. */
const MAX_TICKS = 5;
const DIGITS = 3;

export const round = (/** @type {number} */ value) => Number(value.toPrecision(DIGITS));

// Return a few round numbers from low to high; on a log
// scale 1, 2 and 5 times powers of ten, or these alone.
/**
 * @param {number} low
 * @param {number} high
 * @param {boolean} log
 * @param {number} maxTicks approximate maximum number of ticks
 */
export function ticks(low, high, log, maxTicks = MAX_TICKS) {
  if (log) {
    const [first, last] = [low, high].map((value) => Math.floor(Math.log10(value)));
    const decades = Array.from({ length: last - first + 1 }, (_, k) =>
      [1, 2, 5].map((digit) => round(digit * 10 ** (first + k))),
    );
    const inside = decades.flat().filter((value) => value >= low && value <= high);
    const tens = inside.filter((value) => Number.isInteger(round(Math.log10(value))));
    return inside.length > maxTicks && tens.length > 1 ? tens : inside;
  }
  const rough = (high - low) / maxTicks;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((digit) => digit * power).find((wide) => wide >= rough) ?? rough;
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, k) =>
    round((first + k) * step),
  );
}

// Return the function that maps values to positions: the ends of an axis to the ends of its line.
/**
 * @param {[low: number, high: number]} ends
 * @param {[from: number, to: number]} places
 * @param {boolean} log
 */
export function scaleOf([low, high], [from, to], log = false) {
  const of = log ? Math.log10 : (/** @type {number} */ value) => value;
  const span = of(high) - of(low) || 1;
  return (/** @type {number} */ value) => from + ((of(value) - of(low)) / span) * (to - from);
}

// Return the values of all columns as an SVG path, with gaps where a value is missing.
/**
 * @param {number[]} values
 * @param {(column: number) => number} x
 * @param {(value: number) => number} y
 */
export const linePath = (values, x, y) =>
  values
    .map((value, k) =>
      Number.isFinite(value)
        ? `${Number.isFinite(values[k - 1]) ? "L" : "M"}${x(k).toFixed(1)} ${y(value).toFixed(1)}`
        : "",
    )
    .join("");

// Return a straight line across a plot, horizontal at y or vertical at x.
/**
 * @param {string} name
 * @param {{ x?: number, y?: number }} at
 * @param {[from: number, to: number]} ends
 */
export const rule = (name, { x, y }, [from, to]) =>
  svg(
    "line",
    x === undefined
      ? { class: name, x1: from, x2: to, y1: y ?? 0, y2: y ?? 0 }
      : { class: name, x1: x, x2: x, y1: from, y2: to },
  );

// Move a vertical line.
/**
 * @param {SVGElement} line
 * @param {number} x
 */
export function moveRule(line, x) {
  for (const end of ["x1", "x2"]) line.setAttribute(end, String(x));
}
