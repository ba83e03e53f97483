// A path through cells while it is drawn: its next cells and its defects. Paths are immutable lists
// of keys; planner/chain/path.py checks complete ones in the same way.

const FEWEST = 3;

// Return the cells that share a face with a cell.
/**
 * @param {number} key
 * @param {number} size
 */
export function neighbours(key, size) {
  const adjacent = [];
  for (let step = 1; step < size ** 3; step *= size) {
    // along rows, columns and layers
    const place = Math.floor(key / step) % size;
    if (place > 0) adjacent.push(key - step);
    if (place < size - 1) adjacent.push(key + step);
  }
  return adjacent;
}

/**
 * @param {number} a
 * @param {number} b
 * @param {number} size
 */
export const touch = (a, b, size) => neighbours(a, size).includes(b);

// Return the defects of a path through filled cells.
/**
 * @param {Painted} painted
 * @returns {PathChecked}
 */
export function checked({ cells, size, path }) {
  /** @type {Map<number, number>} */
  const place = new Map();
  /** @type {[number, number][]} */
  const repeats = [];
  /** @type {number[]} */
  const gaps = [];
  let count = 0;
  let odd = 0;
  path.forEach((key, index) => {
    const first = place.get(key);
    if (first === undefined) place.set(key, index);
    else repeats.push([first, index]);
    if (index && !touch(path[index - 1], key, size)) gaps.push(index - 1);
  });
  const missing = [];
  for (let key = 0; key < cells.length; key++) {
    if (!cells[key]) continue;
    count++;
    odd += ((key % size) + (Math.floor(key / size) % size) + Math.floor(key / (size * size))) % 2;
    if (!place.has(key)) missing.push(key);
  }
  const difference = Math.abs(count - 2 * odd);
  const complete = path.length >= FEWEST && !gaps.length && !repeats.length && !missing.length;
  return {
    length: path.length,
    cells: count,
    gaps,
    repeats,
    missing,
    lost: lost(missing, path, size),
    difference,
    complete,
  };
}

// Return the missing cells that cannot be reached from either end of the path.
/**
 * @param {number[]} missing
 * @param {readonly number[]} path
 * @param {number} size
 */
function lost(missing, path, size) {
  if (!path.length) return [];
  const unreached = new Set(missing);
  const todo = [path[0], path[path.length - 1]];
  for (let key = todo.pop(); key !== undefined; key = todo.pop()) {
    for (const next of neighbours(key, size)) if (unreached.delete(next)) todo.push(next);
  }
  return [...unreached];
}

// Return a sentence or two about the path, with the tone: an error, success, or work in progress.
/**
 * @param {PathChecked} found
 * @returns {{ text: string, tone: "" | "good" | "bad" }}
 */
export function pathText({
  length,
  cells,
  gaps,
  repeats,
  missing,
  lost: apart,
  difference,
  complete,
}) {
  if (repeats.length) {
    const [first, second] = repeats[0];
    return {
      text:
        `Cells ${first + 1} and ${second + 1} of the path are the same cell. A path visits ` +
        `each cell only once.`,
      tone: "bad",
    };
  }
  if (gaps.length) {
    return {
      text:
        `Cells ${gaps[0] + 1} and ${gaps[0] + 2} do not touch. Add cells between them, or ` +
        `cut the path there.`,
      tone: "bad",
    };
  }
  if (complete) return { text: `The path visits all ${cells} cells.`, tone: "good" };
  if (length && !missing.length)
    return { text: `The path has only ${length} cells. It needs at least ${FEWEST}.`, tone: "" };
  const so = length ? `The path visits ${length} of ${cells} cells.` : "No path yet.";
  if (difference > 1) {
    return {
      text:
        `${so} No path visits all cells: a path alternates between the two colours of a ` +
        `chessboard, but one colour has ${difference} more cells than the other. Add or remove ` +
        `cells until the difference is at most 1.`,
      tone: "bad",
    };
  }
  if (apart.length)
    return {
      text: `${so} The path can no longer reach ${apart.length} of the remaining cells.`,
      tone: "bad",
    };
  return { text: length ? so : `${so} Choose the tool Path and drag from cell to cell.`, tone: "" };
}

// Add a cell to a path: at the drawn end, at the other end if it
// touches only that, or in a gap that it closes. The cell before the
// end removes the end. Return the reason if the cell cannot be added.
/**
 * @param {DrawnPath} drawn
 * @param {number} key
 * @param {number} size
 * @returns {DrawnPath | string}
 */
export function extended({ path, atStart }, key, size) {
  if (!path.length) return { path: [key], atStart: false };
  const last = path.length - 1;
  const index = path.indexOf(key);
  if (index >= 0) {
    const [end, before] = atStart ? [0, 1] : [last, last - 1];
    if (index === end) return { path, atStart };
    if (index === before && last > 0)
      return { path: atStart ? path.slice(1) : path.slice(0, -1), atStart };
    if (index === 0 || index === last) return { path, atStart: index === 0 };
    return `This is already cell ${index + 1} of the path. A path visits each cell only once.`;
  }
  for (let k = 0; k < last; k++) {
    if (
      !touch(path[k], path[k + 1], size) &&
      touch(path[k], key, size) &&
      touch(key, path[k + 1], size)
    ) {
      return { path: path.toSpliced(k + 1, 0, key), atStart };
    }
  }
  const ends = [touch(key, path[0], size), touch(key, path[last], size)];
  if (!ends[0] && !ends[1]) return "The next cell must share a face with an end of the path.";
  const start = atStart ? ends[0] : !ends[1];
  return { path: start ? [key, ...path] : [...path, key], atStart: start };
}

// Cut a path at a cell, which becomes the drawn end; the part with the other end remains.
/**
 * @param {DrawnPath} drawn
 * @param {number} key
 * @returns {DrawnPath}
 */
export function cut({ path, atStart }, key) {
  const index = path.indexOf(key);
  if (index < 0) return { path, atStart };
  return { path: atStart ? path.slice(index) : path.slice(0, index + 1), atStart };
}

// Return the drawn end of a path; null if it is empty.
/** @param {DrawnPath} drawn */
export const headOf = ({ path, atStart }) => path.at(atStart ? 0 : -1) ?? null;

// Return the neighbours of the drawn end that the path has not visited.
/**
 * @param {DrawnPath} drawn
 * @param {number} size
 */
export function nextCells(drawn, size) {
  const head = headOf(drawn);
  const visited = new Set(drawn.path);
  return head === null ? [] : neighbours(head, size).filter((key) => !visited.has(key));
}

// Find a path through a few cells from a start cell by backtracking; null if there is none.
/**
 * @param {number[]} keys
 * @param {number} start
 * @param {number} size
 * @returns {number[] | null}
 */
export function through(keys, start, size) {
  const unvisited = new Set(keys);
  /** @type {number[]} */
  const path = [];
  const visit = (/** @type {number} */ key) => {
    unvisited.delete(key);
    path.push(key);
    if (!unvisited.size || neighbours(key, size).some((next) => unvisited.has(next) && visit(next)))
      return true;
    unvisited.add(key);
    path.pop();
    return false;
  };
  return visit(start) ? path : null;
}
