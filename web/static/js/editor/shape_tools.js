// Tools that change many cells of a painting at once. They compute: what they are given stays as it is.
import { LARGEST, SIZES, cellOf, keyOf, keysOf } from "./painting.js";

/** @typedef {0 | 1 | 2} Axis of rows, columns and layers */

// Cells of one layer that hang together with one by sides and are filled, or empty, as it is.
/**
 * @param {Painted} painted
 * @param {number} start
 */
export function region({ cells, size }, start) {
  const seen = new Set([start]);
  for (const key of seen) {
    const [x, y, z] = cellOf(key, size);
    for (const [i, j] of [[x + 1, y], [x - 1, y], [x, y + 1], [x, y - 1]]) {
      if (Math.min(i, j) < 0 || Math.max(i, j) >= size) continue;
      const next = keyOf(i, j, z, size);
      if (cells[next] === cells[start]) seen.add(next);
    }
  }
  return [...seen];
}

// All cells of the box that two cells are corners of.
/**
 * @param {number} one
 * @param {number} other
 * @param {number} size
 */
export function box(one, other, size) {
  const [a, b] = [cellOf(one, size), cellOf(other, size)];
  const [low, high] = [a.map((v, k) => Math.min(v, b[k])), a.map((v, k) => Math.max(v, b[k]))];
  const keys = [];
  for (let z = low[2]; z <= high[2]; z++) {
    for (let x = low[0]; x <= high[0]; x++) for (let y = low[1]; y <= high[1]; y++) keys.push(keyOf(x, y, z, size));
  }
  return keys;
}

// The smallest and the largest coordinates of cells; null without any.
/** @param {number[][]} cells */
const extremes = (cells) => (cells.length ? {
  low: cells.reduce((low, cell) => low.map((v, axis) => Math.min(v, cell[axis]))),
  high: cells.reduce((high, cell) => high.map((v, axis) => Math.max(v, cell[axis]))),
} : null);

/** @param {Painted} painted */
export const bounds = ({ cells, size }) => extremes(keysOf(cells).map((key) => cellOf(key, size)));

// The painting with each cell put elsewhere, in a grid of any size that has room for them.
/**
 * @param {Painted} painted
 * @param {(cell: Vector) => number[]} place
 * @param {number} size
 * @returns {Painted}
 */
function placed(painted, place, size = painted.size) {
  const at = (/** @type {number} */ key) => {
    const [x, y, z] = place(cellOf(key, painted.size));
    return keyOf(x, y, z, size);
  };
  const cells = new Uint8Array(size ** 3);
  painted.cells.forEach((filled, key) => { if (filled) cells[at(key)] = 1; });
  return { size, cells, path: painted.path.map(at) };
}

// The shape and its path as in a mirror at its own middle.
/**
 * @param {Painted} painted
 * @param {Axis} axis
 */
export function mirrored(painted, axis) {
  const within = bounds(painted);
  if (!within) return painted;
  const sum = within.low[axis] + within.high[axis];
  return placed(painted, (cell) => cell.with(axis, sum - cell[axis]));
}

// The shape and its path moved by so many cells, or by as many as there is room for.
/**
 * @param {Painted} painted
 * @param {Axis} axis
 * @param {number} by
 */
export function moved(painted, axis, by) {
  const within = bounds(painted);
  if (!within) return painted;
  const step = Math.min(painted.size - 1 - within.high[axis], Math.max(-within.low[axis], by));
  return step ? placed(painted, (cell) => cell.with(axis, cell[axis] + step)) : painted;
}

// The painting in a grid of another size, its middle kept in rows and columns, its layers where they are
// if there is room; null when the shape is too large.
/**
 * @param {Painted} painted
 * @param {number} size
 */
export function resized(painted, size) {
  const within = bounds(painted) ?? { low: [0, 0, 0], high: [0, 0, 0] };
  const { low, high } = within;
  if (high.some((v, axis) => v - low[axis] >= size)) return null;
  const middle = Math.floor((size - painted.size) / 2);
  const by = [middle, middle, 0].map((v, axis) => Math.min(size - 1 - high[axis], Math.max(-low[axis], v)));
  return placed(painted, (cell) => cell.map((v, axis) => v + by[axis]), size);
}

// The painting of cells that came with a file, in the middle of the smallest grid, no smaller than one, that
// has room; ordered cells are its path. Throws an Error that says how large they are when none has.
/**
 * @param {number[][]} cells
 * @param {{ ordered: boolean, least: number }} how
 * @returns {Painted}
 */
export function imported(cells, { ordered, least }) {
  const within = extremes(cells);
  if (!within) throw new Error("The shape has no cells.");
  const { low, high } = within;
  const extents = high.map((v, axis) => v - low[axis] + 1);
  const fits = SIZES.find((side) => Math.max(...extents) <= side);
  if (!fits) throw new Error(`The shape is ${extents.join("×")} cells large, but the largest grid is ${LARGEST}×${LARGEST}×${LARGEST} cells. Use a smaller shape, or a shape with fewer and larger cells.`);
  const size = Math.max(fits, least);
  const margin = extents.map((extent, axis) => (axis === 2 ? 0 : Math.floor((size - extent) / 2)));
  const keys = cells.map((cell) => {
    const [x, y, z] = cell.map((v, axis) => v - low[axis] + margin[axis]);
    return keyOf(x, y, z, size);
  });
  const filled = new Uint8Array(size ** 3);
  for (const key of keys) filled[key] = 1;
  return { size, cells: filled, path: ordered ? keys : [] };
}

// These cells, and those opposite them on the other side of the grid's middle along each axis.
/**
 * @param {number[]} keys
 * @param {number} size
 * @param {Iterable<Axis>} axes
 */
export function symmetric(keys, size, axes) {
  let found = keys;
  for (const axis of axes) {
    const opposite = found.map((key) => {
      const [x, y, z] = cellOf(key, size).with(axis, size - 1 - cellOf(key, size)[axis]);
      return keyOf(x, y, z, size);
    });
    found = [...new Set([...found, ...opposite])];
  }
  return found;
}

// The cells of a layer that a pointer passed on its straight way from one to another, both included; by
// sides, each shares one with the next.
/**
 * @param {[x: number, y: number]} from
 * @param {[x: number, y: number]} to
 * @param {boolean} bySides
 */
export function passed([x, y], [i, j], bySides = false) {
  const count = bySides ? Math.abs(i - x) + Math.abs(j - y) : Math.max(Math.abs(i - x), Math.abs(j - y));
  /** @type {[x: number, y: number][]} */
  const found = [[x, y]];
  for (let k = 1; k <= count; k++) {
    const share = k / count;
    if (!bySides) { found.push([Math.round(x + share * (i - x)), Math.round(y + share * (j - y))]); continue; }
    const [a, b] = found[k - 1];
    const [behindX, behindY] = [Math.abs(i - x) * share - Math.abs(a - x), Math.abs(j - y) * share - Math.abs(b - y)];
    found.push(behindX >= behindY ? [a + Math.sign(i - x), b] : [a, b + Math.sign(j - y)]);
  }
  return found;
}
