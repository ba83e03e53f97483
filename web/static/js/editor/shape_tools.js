// Tools that change many cells of a painting at once. They
// return new values and do not modify their arguments.
import { LARGEST, SIZES, cellOf, keyOf, keysOf } from "./painting.js";

const LETTER_CELLS = 5; // per side
const LETTER_GAP = 1; // cells between two letters

/** @typedef {0 | 1 | 2} Axis of rows, columns and layers */

// Return the connected region of a cell in its layer: cells that are filled, or empty, like it.
/**
 * @param {Painted} painted
 * @param {number} start
 */
export function region({ cells, size }, start) {
  const keys = new Set([start]);
  for (const key of keys) {
    const [x, y, z] = cellOf(key, size);
    for (const [i, j] of [
      [x + 1, y],
      [x - 1, y],
      [x, y + 1],
      [x, y - 1],
    ]) {
      if (Math.min(i, j) < 0 || Math.max(i, j) >= size) continue;
      const next = keyOf(i, j, z, size);
      if (cells[next] === cells[start]) keys.add(next);
    }
  }
  return [...keys];
}

// Return all cells of the box between two corner cells.
/**
 * @param {number} corner
 * @param {number} opposite
 * @param {number} size
 */
export function box(corner, opposite, size) {
  const [a, b] = [cellOf(corner, size), cellOf(opposite, size)];
  const [low, high] = [a.map((v, k) => Math.min(v, b[k])), a.map((v, k) => Math.max(v, b[k]))];
  const keys = [];
  for (let z = low[2]; z <= high[2]; z++) {
    for (let x = low[0]; x <= high[0]; x++)
      for (let y = low[1]; y <= high[1]; y++) keys.push(keyOf(x, y, z, size));
  }
  return keys;
}

// Return the minimum and maximum coordinates of cells; null without cells.
/** @param {number[][]} cells */
const extremes = (cells) =>
  cells.length
    ? {
        low: cells.reduce((low, cell) => low.map((v, axis) => Math.min(v, cell[axis]))),
        high: cells.reduce((high, cell) => high.map((v, axis) => Math.max(v, cell[axis]))),
      }
    : null;

/** @param {Painted} painted */
export const bounds = ({ cells, size }) => extremes(keysOf(cells).map((key) => cellOf(key, size)));

// Return the painting with each cell moved by a function, in a grid of the given size.
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
  painted.cells.forEach((filled, key) => {
    if (filled) cells[at(key)] = 1;
  });
  return { size, cells, path: painted.path.map(at) };
}

// Mirror the shape and its path at the middle of the shape.
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

// Move the shape and its path by some cells, as far as the grid allows.
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

// Move the painting to a grid of another size. The middle of the grid is preserved in rows and
// columns, and the layers if possible. Return null if the shape is too large.
/**
 * @param {Painted} painted
 * @param {number} size
 */
export function resized(painted, size) {
  const within = bounds(painted) ?? { low: [0, 0, 0], high: [0, 0, 0] };
  const { low, high } = within;
  if (high.some((v, axis) => v - low[axis] >= size)) return null;
  const middle = Math.floor((size - painted.size) / 2);
  const by = [middle, middle, 0].map((v, axis) =>
    Math.min(size - 1 - high[axis], Math.max(-low[axis], v)),
  );
  return placed(painted, (cell) => cell.map((v, axis) => v + by[axis]), size);
}

// Return the painting with a letter on its right, in its lowest layer, joined to it by the shortest
// row of cells. The grid grows as needed. Return null if the largest grid has no room.
/**
 * @param {Painted} painted
 * @param {[row: number, column: number][]} letter
 * @returns {Painted | null}
 */
export function withLetter(painted, letter) {
  const within = bounds(painted);
  const columns = within ? within.high[1] - within.low[1] + 1 + LETTER_GAP : 0;
  const size = SIZES.find((side) => side >= painted.size && side >= columns + LETTER_CELLS);
  const grid = size && resized(painted, size);
  if (!size || !grid) return null;
  const margin = (/** @type {number} */ width) => Math.floor((size - width) / 2);
  const { cells, path } = moved(
    grid,
    1,
    margin(columns + LETTER_CELLS) - (bounds(grid)?.low[1] ?? 0),
  );
  const low = bounds({ size, cells, path })?.low ?? [margin(LETTER_CELLS), 0, 0];
  const [top, layer] = [Math.min(low[0], size - LETTER_CELLS), low[2]];
  const column = margin(columns + LETTER_CELLS) + columns;
  const written = letter.map(([x, y]) => keyOf(top + x, column + y, layer, size));
  const gaps = [...Array(LETTER_CELLS).keys()]
    .map((x) => {
      const start = keyOf(top + x, 0, layer, size);
      const row = [...cells.subarray(start, start + column)];
      const [before, after] = [
        row.lastIndexOf(1),
        Math.min(...letter.filter(([i]) => i === x).map(([, y]) => column + y)),
      ];
      return before < 0
        ? []
        : Array.from({ length: after - before - 1 }, (_none, k) => start + before + 1 + k);
    })
    .filter(({ length }) => length);
  const join = gaps.reduce(
    (best, gap) => (best.length && best.length < gap.length ? best : gap),
    [],
  );
  for (const key of [...written, ...join]) cells[key] = 1;
  return { size, cells, path };
}

// Return the painting of cells from a file, centred in the smallest grid of
// at least `least` cells that they fit in; ordered cells become its path.
// Throws an Error that states their extents if no grid is large enough.
/**
 * @param {number[][]} cells
 * @param {{ ordered: boolean, least: number }} how
 * @returns {Painted}
 */
export function imported(cells, { ordered, least: minSize }) {
  const within = extremes(cells);
  if (!within) throw new Error("The shape has no cells.");
  const { low, high } = within;
  const extents = high.map((v, axis) => v - low[axis] + 1);
  const fits = SIZES.find((side) => Math.max(...extents) <= side);
  if (!fits)
    throw new Error(
      `The shape measures ${extents.join("×")} cells, but the largest grid is ` +
        `${LARGEST}×${LARGEST}×${LARGEST} cells. Use a smaller shape, or a shape with fewer and ` +
        `larger cells.`,
    );
  const size = Math.max(fits, minSize);
  const margin = extents.map((extent, axis) => (axis === 2 ? 0 : Math.floor((size - extent) / 2)));
  const keys = cells.map((cell) => {
    const [x, y, z] = cell.map((v, axis) => v - low[axis] + margin[axis]);
    return keyOf(x, y, z, size);
  });
  const filled = new Uint8Array(size ** 3);
  for (const key of keys) filled[key] = 1;
  return { size, cells: filled, path: ordered ? keys : [] };
}

// Return the cells and their mirror images at the middle of the grid along each axis.
/**
 * @param {number[]} keys
 * @param {number} size
 * @param {Iterable<Axis>} axes
 */
export function symmetric(keys, size, axes) {
  let allKeys = keys;
  for (const axis of axes) {
    const opposite = allKeys.map((key) => {
      const [x, y, z] = cellOf(key, size).with(axis, size - 1 - cellOf(key, size)[axis]);
      return keyOf(x, y, z, size);
    });
    allKeys = [...new Set([...allKeys, ...opposite])];
  }
  return allKeys;
}

// Return the cells of a layer on the straight line between two cells, both included. With
// `bySides`, consecutive cells share a side.
/**
 * @param {[x: number, y: number]} from
 * @param {[x: number, y: number]} to
 * @param {boolean} bySides
 */
export function passed([x, y], [i, j], bySides = false) {
  const count = bySides
    ? Math.abs(i - x) + Math.abs(j - y)
    : Math.max(Math.abs(i - x), Math.abs(j - y));
  /** @type {[x: number, y: number][]} */
  const points = [[x, y]];
  for (let k = 1; k <= count; k++) {
    const share = k / count;
    if (!bySides) {
      points.push([Math.round(x + share * (i - x)), Math.round(y + share * (j - y))]);
      continue;
    }
    const [a, b] = points[k - 1];
    const [behindX, behindY] = [
      Math.abs(i - x) * share - Math.abs(a - x),
      Math.abs(j - y) * share - Math.abs(b - y),
    ];
    points.push(behindX >= behindY ? [a + Math.sign(i - x), b] : [a, b + Math.sign(j - y)]);
  }
  return points;
}
