// The hand: the tool that is held, and what a press, a drag and a lift do with it. Needs no page.
import { cut, extended, headOf, touch } from "./cell_path.js";
import { cellOf, keyOf } from "./painting.js";
import { box, mirrored, moved, region, symmetric } from "./shape_tools.js";

/** @typedef {"paint" | "fill" | "box" | "move" | "path"} Tool */

/** @type {Record<Tool, [hint: string, keys: string]>} */
export const HINTS = {
  paint: ["Click or drag to paint. Start on a painted cell to erase.", "Page Up and Page Down change the layer."],
  fill: ["Click a connected region in this layer. Empty cells are filled, painted cells are cleared.", ""],
  box: ["Drag from corner to corner, or click two corners in any layers. Start on a painted cell to erase.", ""],
  move: ["Drag the shape, or use the buttons.", "Arrow keys, Page Up and Page Down also move it."],
  path: ["Drag from cell to cell, starting at either end. Drag back to undo. Possible next cells are framed. Complete finds the rest.",
    "You can also draw with Shift and the arrow keys, Page Up or Page Down. X cuts, Backspace undoes."],
};

export class Hand {
  /** @param {import("./painting.js").Painting} painting */
  constructor(painting) {
    this.painting = painting;
    /** @type {Tool} */
    this.tool = "paint";
    /** @type {Set<0 | 1 | 2>} along which painting is mirrored at the middle of the grid */
    this.axes = new Set();
    /** @type {number | null} of a box that is begun */
    this.corner = null;
    this.atStart = false;
    /** @type {string} why the last thing could not be done; empty when it could */
    this.refused = "";
    this.filling = true;
    this.from = 0;
    this.to = 0;
  }

  /** @returns {DrawnPath} */
  get drawn() { return { path: this.painting.path, atStart: this.atStart }; }

  /** @param {Tool} tool */
  take(tool) {
    this.tool = tool;
    this.corner = null;
    this.refused = "";
  }

  /** @param {number} key */
  press(key) {
    const { painting } = this;
    painting.begin();
    this.refused = "";
    this.from = this.to = key;
    if (this.corner === null) this.filling = !painting.cells[key];
    if (this.tool === "paint") this.paint([key]);
    else if (this.tool === "fill") this.paint(region(painting.state, key));
    else if (this.tool === "path") this.draw(key);
  }

  /** @param {number[]} keys that were passed, in order */
  drag(keys) {
    this.to = keys[keys.length - 1] ?? this.to;
    if (this.tool === "paint") this.paint(keys);
    else if (this.tool === "move") this.shift();
    else if (this.tool === "path") {
      for (const key of keys) {
        const head = headOf(this.drawn);
        if (head !== null && touch(head, key, this.painting.size)) this.draw(key);
      }
    }
  }

  /** @param {boolean} kept */
  lift(kept) {
    const { painting, from, to } = this;
    if (this.tool === "box" && kept) {
      if (this.corner === null && from === to) this.corner = from;
      else {
        this.paint(box(this.corner ?? from, to, painting.size));
        this.corner = null;
      }
    }
    if (kept) painting.end(); else painting.cancel();
  }

  /** @param {number[]} keys */
  paint(keys) { this.painting.paint(symmetric(keys, this.painting.size, this.axes), this.filling); }

  // Draws one cell of the path.
  /** @param {number} key */
  draw(key) {
    const next = extended(this.drawn, key, this.painting.size);
    this.refused = typeof next === "string" ? next : "";
    if (typeof next !== "string") this.follow(next);
  }

  /** @param {DrawnPath} drawn */
  follow({ path, atStart }) {
    this.painting.draw(path);
    this.atStart = atStart;
  }

  shift() {
    const { painting } = this;
    if (!painting.before) return;
    const [x, y] = cellOf(this.from, painting.size);
    const [i, j] = cellOf(this.to, painting.size);
    painting.become(moved(moved(painting.before, 0, i - x), 1, j - y));
  }

  // One step: what is done with the painting, to be undone at once.
  /** @param {() => void} act */
  step(act) {
    this.refused = "";
    this.painting.begin();
    act();
    return this.painting.end();
  }

  /**
   * @param {0 | 1 | 2} axis
   * @param {number} by
   */
  move(axis, by) { this.step(() => this.painting.become(moved(this.painting.state, axis, by))); }

  /** @param {0 | 1 | 2} axis */
  mirror(axis) { this.step(() => this.painting.become(mirrored(this.painting.state, axis))); }

  // Draws from the head in a direction; from a cell where there is no path. Says where the head is then.
  /**
   * @param {number[]} by
   * @param {number} from
   */
  drawOn(by, from) {
    const { size } = this.painting;
    const head = headOf(this.drawn);
    const [x, y, z] = cellOf(head ?? from, size).map((v, axis) => v + (head === null ? 0 : by[axis]));
    if (Math.min(x, y, z) < 0 || Math.max(x, y, z) >= size) this.refused = "The grid ends here. Choose a larger grid.";
    else this.step(() => this.draw(keyOf(x, y, z, size)));
    return headOf(this.drawn);
  }

  takeBack() {
    const { path, atStart } = this.drawn;
    this.step(() => { this.painting.path = atStart ? path.slice(1) : path.slice(0, -1); });
  }

  /** @param {number} key */
  cutAt(key) {
    if (!this.painting.path.includes(key)) { this.refused = "First touch the path cell where the path should end."; return; }
    this.step(() => this.follow(cut(this.drawn, key)));
  }

  // The chain begins at the other end; what is drawn from stays.
  reverse() {
    this.step(() => this.follow({ path: this.painting.path.toReversed(), atStart: !this.atStart }));
  }
}
