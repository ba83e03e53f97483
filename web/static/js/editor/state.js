// State of the editor, without the page: the draft, the tool
// and its pointer actions, and the shape that would be folded.
import { integerText } from "../lib/text.js";
import { checked, cut, extended, headOf, pathText, touch } from "./cell_path.js";
import { Draft, Painting, cellOf, keyOf, keysOf, parts } from "./painting.js";
import {
  bounds,
  box,
  mirrored,
  moved,
  region,
  resized,
  symmetric,
  withLetter,
} from "./shape_tools.js";

/** @typedef {Draft["tool"]} Tool */

/** Minimum number of modules that the service folds. */
export const MIN_MODULES = 8;
const MODULES_PER_CELL = { no: 8, yes: 1, path: 1 };
const LETTERS = /^(?:Letter )?([A-Z]+)$/; // name of a shape that consists of letters

/**
 * Status of the shape that would be folded.
 * @typedef {object} Standing
 * @property {number} cells
 * @property {string} text description, including defects
 * @property {"" | "good" | "bad"} tone
 * @property {string} limit text about the limit, unless it is in the description
 * @property {boolean} complete whether a drawn path visits all cells
 * @property {boolean} completable whether the rest of a path can be searched
 * @property {boolean} ready whether it can be folded
 */

export class Editor {
  /** @param {number} maxModules */
  constructor(maxModules) {
    this.maxModules = maxModules;
    this.painting = new Painting();
    this.draft = new Draft();
    this.layer = 0;
    this.sending = false;
    /** @type {Set<0 | 1 | 2>} axes along which painting is mirrored at the middle of the grid */
    this.axes = new Set();
    /** @type {number | null} first corner of an unfinished box */
    this.corner = null;
    this.atStart = false;
    /** @type {string} reason why the last action failed; empty if it succeeded */
    this.refused = "";
    this.filling = true;
    this.from = 0;
    this.to = 0;
  }

  get tool() {
    return this.draft.tool;
  }

  /** @returns {DrawnPath} */
  get drawn() {
    return { path: this.painting.path, atStart: this.atStart };
  }

  // The path, if it is displayed.
  get shownPath() {
    return this.tool === "path" || this.draft.conversion === "path" ? this.drawn : null;
  }

  get name() {
    return this.draft.name.trim() || "My shape";
  }

  /** @param {string} end */
  fileName(end) {
    return `${this.name.replaceAll(/[^\p{L}\p{N} _-]+/gu, "").trim() || "shape"}.${end}`;
  }

  /** @returns {Standing} */
  get standing() {
    const {
      painting,
      draft: { conversion },
      maxModules,
    } = this;
    const cells = painting.filled;
    const path = conversion === "path" ? checked(painting.state) : null;
    const modules = cells * MODULES_PER_CELL[conversion];
    const pieces = path ? 1 : parts(painting.cells, painting.size).length;
    const large = modules > maxModules;
    const tooFew = !path && modules > 0 && modules < MIN_MODULES;
    const words =
      path && cells
        ? pathText(path)
        : {
            text:
              `${integerText(modules)} modules` +
              `${tooFew ? `. A fold needs at least ${MIN_MODULES}.` : ""}`,
            tone: /** @type {const} */ (""),
          };
    if (pieces > 1)
      Object.assign(words, {
        text: `The shape has ${pieces} separate pieces. Connect them face to face.`,
        tone: "bad",
      });
    if (large)
      Object.assign(words, {
        text:
          `The shape needs ${integerText(modules)} modules, but the limit is ` +
          `${integerText(maxModules)}. Paint fewer cells.`,
        tone: "bad",
      });
    const visited = Boolean(path?.complete);
    return {
      cells,
      tone: words.tone,
      text: cells ? words.text : "",
      complete: visited,
      limit:
        large || !cells
          ? ""
          : `${path ? `${integerText(modules)} modules. ` : ""}Limit: ` +
            `${integerText(maxModules)} modules.`,
      completable: cells > 0 && !visited && !large,
      ready: cells > 0 && !large && (path ? visited : pieces === 1 && !tooFew),
    };
  }

  // Show a layer, or the nearest existing one.
  /** @param {number} layer */
  turn(layer) {
    this.layer = Math.min(this.painting.size - 1, Math.max(0, layer));
  }

  /** @param {Tool} tool */
  take(tool) {
    this.corner = null;
    this.refused = "";
    this.draft.note({ tool, ...(tool === "path" && { conversion: "path" }) });
  }

  // Choose the conversion of cells to modules. An own path is drawn with its tool.
  /** @param {Draft["conversion"]} conversion */
  choose(conversion) {
    this.draft.note({ conversion });
    if ((conversion === "path") !== (this.tool === "path"))
      this.take(conversion === "path" ? "path" : "paint");
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

  /** @param {number[]} keys of the passed cells, in order */
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

  /** @param {boolean} completed */
  lift(completed) {
    const { painting, from, to } = this;
    if (this.tool === "box" && completed) {
      if (this.corner === null && from === to) this.corner = from;
      else {
        this.paint(box(this.corner ?? from, to, painting.size));
        this.corner = null;
      }
    }
    if (completed) painting.end();
    else painting.cancel();
  }

  /** @param {number[]} keys */
  paint(keys) {
    this.painting.paint(symmetric(keys, this.painting.size, this.axes), this.filling);
  }

  // Draw one cell of the path.
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

  // Run an action on the painting as one undo step.
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
  move(axis, by) {
    this.step(() => this.painting.become(moved(this.painting.state, axis, by)));
  }

  /** @param {0 | 1 | 2} axis */
  mirror(axis) {
    this.step(() => this.painting.become(mirrored(this.painting.state, axis)));
  }

  // Extend the path from its drawn end in a direction, or start it
  // at a cell. Show the layer of the new drawn end and return it.
  /**
   * @param {number[]} by
   * @param {number} from
   */
  drawOn(by, from) {
    const { size } = this.painting;
    const head = headOf(this.drawn);
    const [x, y, z] = cellOf(head ?? from, size).map(
      (v, axis) => v + (head === null ? 0 : by[axis]),
    );
    if (Math.min(x, y, z) < 0 || Math.max(x, y, z) >= size)
      this.refused = "The grid ends here. Choose a larger grid.";
    else this.step(() => this.draw(keyOf(x, y, z, size)));
    const next = headOf(this.drawn);
    if (next !== null) this.turn(cellOf(next, size)[2]);
    return next;
  }

  takeBack() {
    const { path, atStart } = this.drawn;
    this.step(() => {
      this.painting.path = atStart ? path.slice(1) : path.slice(0, -1);
    });
  }

  /** @param {number} key */
  cutAt(key) {
    if (!this.painting.path.includes(key)) {
      this.refused = "First select the cell where the path should end.";
      return;
    }
    this.step(() => this.follow(cut(this.drawn, key)));
  }

  // Reverse the path; the drawn end stays the same cell.
  reverse() {
    this.step(() => this.follow({ path: this.painting.path.toReversed(), atStart: !this.atStart }));
  }

  clear() {
    this.step(() => this.painting.paint(keysOf(this.painting.cells), false));
    this.draft.clear();
    this.turn(0);
  }

  // Copy the cells of the layer below.
  repeat() {
    const area = this.painting.size ** 2;
    const below = keysOf(this.painting.cells).filter(
      (key) => Math.floor(key / area) === this.layer - 1,
    );
    this.step(() =>
      this.painting.paint(
        below.map((key) => key + area),
        true,
      ),
    );
  }

  // Put a letter on the right of the shape, so that letters become a word.
  /**
   * @param {string} letter
   * @param {[row: number, column: number][]} cells
   */
  write(letter, cells) {
    const {
      painting,
      draft: { name, givenName },
    } = this;
    const written = withLetter(painting.state, cells);
    if (!written) {
      this.refused = "There is no room for another letter, even in the largest grid.";
      return;
    }
    const word = LETTERS.exec(name === givenName ? givenName : "")?.[1];
    if (!painting.filled) this.draft.give(`Letter ${letter}`);
    else if (word) this.draft.give(word + letter);
    this.step(() => painting.become(written));
    this.turn(bounds(written)?.low[2] ?? 0);
  }

  // Replace the shape by that of a file.
  /**
   * @param {Painted} painted
   * @param {string} name
   * @param {boolean} ordered whether its cells are a path
   */
  open(painted, name, ordered) {
    this.step(() => this.painting.become(painted));
    this.atStart = false;
    this.draft.give(name);
    this.layer = 0;
    if (
      !ordered &&
      (this.draft.conversion === "path" ||
        MODULES_PER_CELL.no * this.painting.filled > this.maxModules)
    )
      this.draft.note({ conversion: "yes" });
  }

  /** @param {number} size */
  resize(size) {
    const grid = resized(this.painting.state, size);
    if (grid) this.step(() => this.painting.become(grid));
    else this.refused = "The shape is larger than this grid.";
    this.turn(this.layer);
  }
}
