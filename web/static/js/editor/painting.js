// The draft of the editor: a painting and the name of the shape. A painting has
// the filled cells, the path through them, and the steps for undo and redo. A
// cell (row x, column y, layer z) has the key (z * size + x) * size + y.
import { store, stored } from "../lib/text.js";
import { neighbours } from "./cell_path.js";

export const SIZES = [10, 16, 20, 24, 32];
export const MOST_STEPS = 200;
export const LARGEST = Math.max(...SIZES);
const KEPT = "foldback:painting";
const STORED_STEPS = "foldback:painting-steps";
const MAX_STEPS_CHARS = 1_000_000; // a browser stores about five times as much for a tab
const STORED_DRAFT = "foldback:draft";
const LONGEST_NAME = 60;
const CHOICES = ["no", "yes", "path"];
const TOOLS = ["paint", "fill", "box", "move", "path"];

/**
 * @param {number} x
 * @param {number} y
 * @param {number} z
 * @param {number} size
 */
export const keyOf = (x, y, z, size) => (z * size + x) * size + y;
/**
 * @param {number} key
 * @param {number} size
 * @returns {Vector}
 */
export const cellOf = (key, size) => [
  Math.floor(key / size) % size,
  key % size,
  Math.floor(key / (size * size)),
];

// Return the keys of the filled cells.
/** @param {Uint8Array} cells */
export function keysOf(cells) {
  const keys = [];
  for (let key = 0; key < cells.length; key++) if (cells[key]) keys.push(key);
  return keys;
}

/**
 * @param {Painted} a
 * @param {Painted} b
 */
function isSame(a, b) {
  return (
    a.size === b.size &&
    a.cells.every((filled, key) => filled === b.cells[key]) &&
    a.path.length === b.path.length &&
    a.path.every((key, index) => key === b.path[index])
  );
}

export class Painting {
  constructor() {
    this.size = SIZES[0];
    this.cells = new Uint8Array(this.size ** 3);
    /** @type {readonly number[]} */
    this.path = [];
    /** @type {Painted[]} */
    this.done = [];
    /** @type {Painted[]} */
    this.undone = [];
    /** @type {Painted | null} */
    this.before = null;
    try {
      const painted = unpacked(JSON.parse(stored(KEPT) ?? "null"));
      if (painted) this.become(painted);
      const { done, undone } = JSON.parse(stored(STORED_STEPS, "sessionStorage") ?? "{}");
      [this.done, this.undone] = [done, undone].map((steps) => steps.map(unpacked).filter(Boolean));
    } catch {
      /* the stored value is not a painting */
    }
  }

  // Store the steps for undo and redo until the tab is closed, as many of the last ones as fit.
  leave() {
    let room = MAX_STEPS_CHARS;
    const last = (/** @type {Painted[]} */ steps) => {
      const texts = steps.toReversed().map((step) => JSON.stringify(packed(step)));
      const count = texts.findIndex((text) => (room -= text.length) < 0);
      return `[${(count < 0 ? texts : texts.slice(0, count)).toReversed().join()}]`;
    };
    store(
      STORED_STEPS,
      `{"done":${last(this.done)},"undone":${last(this.undone)}}`,
      "sessionStorage",
    );
  }

  get filled() {
    return this.cells.reduce((sum, filled) => sum + filled, 0);
  }

  /** @returns {Painted} */
  get state() {
    return { size: this.size, cells: this.cells, path: this.path };
  }

  // Begin a step: all changes until its end are one undo step.
  begin() {
    this.before = { ...this.state, cells: this.cells.slice() };
  }

  // Fill or empty cells. Emptied cells leave the path. Return true if a cell changed.
  /**
   * @param {Iterable<number>} keys
   * @param {boolean} filled
   */
  paint(keys, filled) {
    let changed = false;
    for (const key of keys) {
      if (this.cells[key] === Number(filled)) continue;
      this.cells[key] = Number(filled);
      changed = true;
    }
    if (changed && !filled && this.path.length)
      this.path = this.path.filter((key) => this.cells[key]);
    return changed;
  }

  // Set the path and fill its cells.
  /** @param {readonly number[]} path */
  draw(path) {
    this.paint(path, true);
    this.path = path;
  }

  /** @param {Painted} state */
  become({ size, cells, path }) {
    this.size = size;
    this.cells = cells.slice();
    this.path = path;
  }

  // End a step. Return true if it changed anything.
  end() {
    const before = this.before;
    this.before = null;
    if (!before || isSame(before, this.state)) return false;
    this.done.push(before);
    if (this.done.length > MOST_STEPS) this.done.shift();
    this.undone = [];
    this.keep();
    return true;
  }

  // Cancel a step and restore the state before it.
  cancel() {
    if (this.before) this.become(this.before);
    this.before = null;
  }

  undo() {
    return this.turn(this.done, this.undone);
  }

  redo() {
    return this.turn(this.undone, this.done);
  }

  /**
   * @param {Painted[]} from
   * @param {Painted[]} to
   */
  turn(from, to) {
    const state = from.pop();
    if (!state) return false;
    to.push(this.state);
    this.become(state);
    this.keep();
    return true;
  }

  keep() {
    store(KEPT, JSON.stringify(packed(this.state)));
  }
}

/** @param {Painted} painted */
const packed = ({ size, cells, path }) => ({ size, filled: keysOf(cells), path });

// Return a stored painting; null for values that are none.
/**
 * @param {{ size?: unknown, filled?: unknown, path?: unknown } | null} data
 * @returns {Painted | null}
 */
export function unpacked(data) {
  const size = Number(data?.size);
  if (!SIZES.includes(size)) return null;
  const keys = (/** @type {unknown} */ list) =>
    (Array.isArray(list) ? list : []).filter(
      (key) => Number.isInteger(key) && key >= 0 && key < size ** 3,
    );
  const cells = new Uint8Array(size ** 3);
  for (const key of keys(data?.filled)) cells[key] = 1;
  return { size, cells, path: keys(data?.path).filter((key) => cells[key]) };
}

// The rest of the draft: the conversion of cells to modules, the tool, and the name of the shape.
export class Draft {
  constructor() {
    /** @type {"no" | "yes" | "path"} */
    this.conversion = "no";
    /** @type {"paint" | "fill" | "box" | "move" | "path"} */
    this.tool = "paint";
    this.name = "";
    this.givenName = ""; // name from a letter or a file
    try {
      const { conversion, tool, name, givenName } = JSON.parse(stored(STORED_DRAFT) ?? "{}");
      if (CHOICES.includes(conversion)) this.conversion = conversion;
      if (TOOLS.includes(tool)) this.tool = tool;
      if (typeof name === "string") this.name = name.slice(0, LONGEST_NAME);
      if (typeof givenName === "string") this.givenName = givenName;
    } catch {
      /* the stored value is not a draft */
    }
  }

  /**
   * @param {{ conversion?: Draft["conversion"], tool?: Draft["tool"], name?: string,
   *   givenName?: string }} changed
   */
  note(changed) {
    Object.assign(this, changed);
    const { conversion, tool, name, givenName } = this;
    store(STORED_DRAFT, JSON.stringify({ conversion, tool, name, givenName }));
  }

  // Set the name from a letter or a file.
  /** @param {string} name */
  give(name) {
    this.note({ name: name.slice(0, LONGEST_NAME), givenName: name.slice(0, LONGEST_NAME) });
  }

  // Reset the name after clearing, unless the visitor typed it.
  clear() {
    if (this.name === this.givenName) this.note({ name: "", givenName: "" });
  }
}

// Return the face-connected components of the filled cells, as lists of keys.
/**
 * @param {Uint8Array} cells
 * @param {number} size
 */
export function parts(cells, size) {
  const unassigned = cells.slice();
  /** @type {number[][]} */
  const pieces = [];
  for (let start = 0; start < unassigned.length; start++) {
    if (!unassigned[start]) continue;
    const piece = [start];
    unassigned[start] = 0;
    for (const key of piece) {
      for (const next of neighbours(key, size))
        if (unassigned[next]) {
          unassigned[next] = 0;
          piece.push(next);
        }
    }
    pieces.push(piece);
  }
  return pieces;
}

// Return the cells for a voxel file or a path file; with `doubled`, each becomes 2×2×2.
/**
 * @param {readonly number[]} keys
 * @param {number} size
 * @param {boolean} doubled
 */
export function cellsOf(keys, size, doubled = false) {
  const cells = keys.map((key) => cellOf(key, size));
  if (!doubled) return cells;
  return cells.flatMap(([x, y, z]) =>
    [0, 1, 2, 3, 4, 5, 6, 7].map(
      (k) => /** @type {Vector} */ ([2 * x + (k & 1), 2 * y + ((k >> 1) & 1), 2 * z + (k >> 2)]),
    ),
  );
}
