// A painting: which cells are filled, and every stroke so far, to be undone and done again.
export const SIZE = 10;
const KEPT = "foldback:painting";

/**
 * @param {number} x
 * @param {number} y
 * @param {number} z
 */
export const keyOf = (x, y, z) => (z * SIZE + x) * SIZE + y;
/**
 * @param {number} key
 * @returns {Vector}
 */
export const cellOf = (key) => [Math.floor(key / SIZE) % SIZE, key % SIZE, Math.floor(key / (SIZE * SIZE))];

/** @typedef {Map<number, boolean>} Stroke whether each cell, by its key, was filled or emptied */

export class Painting {
  constructor() {
    /** @type {Set<number>} */
    this.cells = new Set();
    /** @type {Stroke[]} */
    this.done = [];
    /** @type {Stroke[]} */
    this.undone = [];
    /** @type {Stroke | null} */
    this.stroke = null;
    try {
      for (const key of JSON.parse(localStorage.getItem(KEPT) ?? "[]")) {
        if (Number.isInteger(key) && key >= 0 && key < SIZE ** 3) this.cells.add(key);
      }
    } catch { /* what was kept is no painting */ }
  }

  /**
   * @param {number} x
   * @param {number} y
   * @param {number} z
   */
  has(x, y, z) { return this.cells.has(keyOf(x, y, z)); }

  begin() { this.stroke = new Map(); }

  // Fills or empties a cell within a stroke; true when that changed it.
  /**
   * @param {number} key
   * @param {boolean} filled
   */
  put(key, filled) {
    if (this.cells.has(key) === filled) return false;
    if (filled) this.cells.add(key); else this.cells.delete(key);
    this.stroke?.set(key, filled);
    return true;
  }

  end() {
    if (this.stroke?.size) { this.done.push(this.stroke); this.undone = []; this.keep(); }
    this.stroke = null;
  }

  undo() { return this.move(this.done, this.undone, (filled) => !filled); }

  redo() { return this.move(this.undone, this.done, (filled) => filled); }

  /**
   * @param {Stroke[]} from
   * @param {Stroke[]} to
   * @param {(filled: boolean) => boolean} turned
   */
  move(from, to, turned) {
    const stroke = from.pop();
    if (!stroke) return false;
    for (const [key, filled] of stroke) { if (turned(filled)) this.cells.add(key); else this.cells.delete(key); }
    to.push(stroke);
    this.keep();
    return true;
  }

  keep() {
    try { localStorage.setItem(KEPT, JSON.stringify([...this.cells])); } catch { /* storage is full or forbidden */ }
  }

  pieces() {
    const left = new Set(this.cells);
    let count = 0;
    for (const start of this.cells) {
      if (!left.delete(start)) continue;
      count++;
      const todo = [start];
      for (let next = todo.pop(); next !== undefined; next = todo.pop()) {
        const [x, y, z] = cellOf(next);
        for (const [i, j, k] of [[x + 1, y, z], [x - 1, y, z], [x, y + 1, z], [x, y - 1, z], [x, y, z + 1], [x, y, z - 1]]) {
          if (Math.min(i, j, k) < 0 || Math.max(i, j, k) >= SIZE) continue;
          const key = keyOf(i, j, k);
          if (left.delete(key)) todo.push(key);
        }
      }
    }
    return count;
  }

  // The cells of a voxel file; doubled, each becomes 2×2×2.
  /** @param {boolean} doubled */
  voxels(doubled) {
    const cells = [...this.cells].map(cellOf);
    if (!doubled) return cells;
    return cells.flatMap(([x, y, z]) => [0, 1, 2, 3, 4, 5, 6, 7]
      .map((k) => [2 * x + (k & 1), 2 * y + ((k >> 1) & 1), 2 * z + (k >> 2)]));
  }
}
