// View of the editor: the sheet, which shows the cells of one layer as a grid of buttons for
// pointers and keyboard, and the controls around it.
import { element, get, svg } from "../lib/text.js";
import { headOf, nextCells, touch } from "./cell_path.js";
import { cellOf, keyOf } from "./painting.js";
import { passed } from "./shape_tools.js";

/** @type {Record<string, [x: number, y: number]>} */
const ARROWS = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };

/** @typedef {import("./state.js").Editor} Editor */
/** @typedef {import("./state.js").Tool} Tool */

export const exact = /** @type {NodeListOf<HTMLInputElement>} */ (
  document.querySelectorAll('[name="exact"]')
);
export const all = (/** @type {string} */ selector) =>
  /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(selector));

// Write a text with its tone, if it changes: screen readers repeat a text that is written again.
/**
 * @param {"count" | "message" | "checked" | "reading"} id
 * @param {string} text
 * @param {string} tone
 */
export function say(id, text, tone = "") {
  if (get(id).textContent !== text) get(id).textContent = text;
  get(id).dataset.tone = tone;
}

// Update the controls around the sheet, and the status of the shape.
/**
 * @param {Editor} editor
 * @param {import("./state.js").Standing} standing
 */
export function showControls(
  { painting, layer, tool, draft, refused, sending },
  { cells, text, tone, limit, complete, completable, ready },
) {
  get("layer").textContent = `Layer ${layer + 1}`;
  const [bottom, pathless, idle] = [layer === 0, !painting.path.length, !ready || sending];
  const off = {
    down: bottom,
    repeat: bottom,
    up: layer === painting.size - 1,
    undo: !painting.done.length,
    redo: !painting.undone.length,
    clear: !cells,
    "save-cells": !cells,
    cut: pathless,
    turn: pathless,
    unpath: pathless,
    complete: !completable,
    preview: idle,
    fold: idle,
  };
  for (const [id, disabled] of Object.entries(off))
    get(/** @type {keyof typeof off} */ (id)).disabled = disabled;
  for (const button of all("[data-tool]"))
    button.ariaPressed = String(button.dataset.tool === tool);
  for (const part of all("[data-for]")) part.hidden = !part.dataset.for?.split(" ").includes(tool);
  get("size").value = String(painting.size);
  get("name").value = draft.name;
  for (const input of exact) input.checked = input.value === draft.conversion;
  get("empty").hidden = cells > 0;
  get("most").textContent = limit;
  get("save-path").hidden = !complete;
  say("count", text, tone);
  say("message", refused);
}

export class Sheet {
  /**
   * @param {HTMLElement} grid
   * @param {Editor} editor
   * @param {(now: boolean) => void} changed updates the page, immediately or with the next frame
   */
  constructor(grid, editor, changed) {
    this.grid = grid;
    this.editor = editor;
    this.changed = changed;
    this.size = 0;
    this.layer = 0;
    /** @type {HTMLButtonElement[][]} */
    this.squares = [];
    /** @type {[x: number, y: number]} */
    this.focused = [0, 0];
    /** @type {[x: number, y: number] | null} */
    this.stroke = null;
    this.lines = svg("svg", { class: "lines", "aria-hidden": "true" });
    grid.addEventListener("pointerdown", (event) => this.press(event));
    grid.addEventListener("pointermove", (event) => this.drag(event));
    grid.addEventListener("pointerup", () => this.lift(true));
    // Two fingers zoom and scroll the page: undo the stroke that the first one began.
    grid.addEventListener("pointercancel", () => this.lift(false));
    grid.addEventListener("keydown", (event) => this.key(event));
    // Screen readers can move the focus to any cell.
    grid.addEventListener("focusin", ({ target }) => {
      if (target instanceof HTMLButtonElement)
        this.focus(Number(target.dataset.x), Number(target.dataset.y));
    });
  }

  get focusedKey() {
    return keyOf(...this.focused, this.layer, this.size);
  }

  /** @param {number} size */
  build(size) {
    if (size === this.size) return;
    this.size = size;
    this.grid.style.setProperty("--size", String(size));
    this.lines.setAttribute("viewBox", `0 0 ${size} ${size}`);
    this.squares = Array.from({ length: size }, (_, x) =>
      Array.from({ length: size }, (_none, y) =>
        element("button", {
          type: "button",
          role: "gridcell",
          tabindex: "-1",
          "data-x": x,
          "data-y": y,
        }),
      ),
    );
    this.grid.replaceChildren(
      ...this.squares.map((row) => element("div", { role: "row" }, ...row)),
      this.lines,
    );
    this.focus(Math.floor(size / 2), Math.floor(size / 2));
  }

  // Show a layer. Only changed attributes are set, because a grid has up to a thousand buttons.
  show() {
    const {
      painting: { size, cells, path },
      layer,
      shownPath: drawn,
      corner,
      axes,
    } = this.editor;
    this.build(size);
    this.layer = layer;
    const place = new Map(drawn ? path.map((key, index) => [key, index]) : []);
    const next = new Set(drawn ? nextCells(drawn, size) : []);
    const below = layer > 0 ? -size * size : NaN;
    this.squares.forEach((row, x) =>
      row.forEach((square, y) => {
        const key = keyOf(x, y, layer, size);
        const on = cells[key] === 1;
        const under = cells[key + below] === 1;
        const index = place.get(key);
        const missing = drawn && on && index === undefined;
        const classes = Object.entries({
          on,
          below: under,
          missing,
          next: next.has(key),
          corner: key === corner,
        })
          .flatMap(([name, applies]) => (applies ? [name] : []))
          .join(" ");
        const step =
          index === undefined
            ? missing
              ? ", not on the path"
              : ""
            : `, cell ${index + 1} of the path`;
        const label =
          `Row ${x + 1}, column ${y + 1}, ${on ? "filled" : "empty"}` +
          `${under ? ", cell below filled" : ""}${step}`;
        if (square.className !== classes) square.className = classes;
        if (square.ariaLabel !== label) square.ariaLabel = label;
        if (square.ariaSelected !== String(on)) square.ariaSelected = String(on);
      }),
    );
    this.grid.classList.toggle("is-mirrored-x", axes.has(0));
    this.grid.classList.toggle("is-mirrored-y", axes.has(1));
    this.lines.replaceChildren(...(drawn ? this.course(drawn) : []));
  }

  // Return the path within the layer; triangles mark its connections to the layers above and below.
  /** @param {DrawnPath} drawn */
  course(drawn) {
    const { path } = drawn;
    let way = "";
    let gaps = "";
    let ups = "";
    path.forEach((key, index) => {
      const [x, y, z] = cellOf(key, this.size);
      for (const adjacent of [path[index - 1], path[index + 1]]) {
        if (adjacent === undefined || z !== this.layer) continue;
        const [i, j, k] = cellOf(adjacent, this.size);
        const joined = touch(key, adjacent, this.size);
        if (joined && k !== z) {
          ups +=
            k > z ? `M${y + 0.5} ${x + 0.08}l.15 .2h-.3z` : `M${y + 0.5} ${x + 0.92}l.15 -.2h-.3z`;
        } else if (k === z && adjacent === path[index + 1]) {
          const text = `M${y + 0.5} ${x + 0.5}L${j + 0.5} ${i + 0.5}`;
          if (joined) way += text;
          else gaps += text;
        } else if (!joined && k !== z) gaps += `M${y + 0.3} ${x + 0.3}l.4 .4m0 -.4l-.4 .4`;
      }
    });
    const spot = (
      /** @type {number} */ key,
      /** @type {string} */ name,
      /** @type {number} */ r,
    ) => {
      const [x, y, z] = cellOf(key, this.size);
      return z === this.layer ? [svg("circle", { class: name, cx: y + 0.5, cy: x + 0.5, r })] : [];
    };
    const head = headOf(drawn);
    return [
      svg("path", { class: "way casing", d: way }),
      svg("path", { class: "way", d: way }),
      svg("path", { class: "gaps", d: gaps }),
      svg("path", { class: "ups", d: ups }),
      ...(path.length ? spot(path[0], "first", 0.2) : []),
      ...(head === null ? [] : spot(head, "head", 0.3)),
    ];
  }

  /** @param {number} place */
  within(place) {
    return Math.min(this.size - 1, Math.max(0, place));
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  focus(x, y) {
    this.squares[this.focused[0]]?.[this.focused[1]]?.setAttribute("tabindex", "-1");
    this.focused = [this.within(x), this.within(y)];
    const square = this.squares[this.focused[0]][this.focused[1]];
    square.tabIndex = 0;
    return square;
  }

  /**
   * @param {PointerEvent} event
   * @returns {[x: number, y: number]}
   */
  at(event) {
    const { left, top, width, height } = this.lines.getBoundingClientRect();
    const place = (/** @type {number} */ share) => this.within(Math.floor(share * this.size));
    return [place((event.clientY - top) / height), place((event.clientX - left) / width)];
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button !== 0 || !event.isPrimary) return;
    this.stroke = this.at(event);
    this.grid.setPointerCapture(event.pointerId);
    this.focus(...this.stroke);
    this.editor.press(this.focusedKey);
    this.changed(false);
  }

  /** @param {PointerEvent} event */
  drag(event) {
    if (!this.stroke || !event.isPrimary) return;
    const to = this.at(event);
    if (to[0] === this.stroke[0] && to[1] === this.stroke[1]) return;
    const from = this.stroke;
    this.stroke = to;
    this.focus(...to);
    this.editor.drag(
      passed(from, to, this.editor.tool === "path")
        .slice(1)
        .map(([x, y]) => keyOf(x, y, this.layer, this.size)),
    );
    this.changed(false);
  }

  /** @param {boolean} completed */
  lift(completed) {
    if (!this.stroke) return;
    this.stroke = null;
    this.squares[this.focused[0]][this.focused[1]].focus({ preventScroll: true });
    this.editor.lift(completed);
    this.changed(true);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const by = ARROWS[event.key];
    if (by) this.arrow(by, event.shiftKey);
    else if (event.key === " " || event.key === "Enter") {
      this.editor.press(this.focusedKey);
      this.editor.lift(true);
      this.changed(true);
    } else return;
    event.preventDefault();
  }

  // Handle an arrow key: move the shape, draw the path, or focus the next cell.
  /**
   * @param {[x: number, y: number]} by
   * @param {boolean} shift
   */
  arrow([x, y], shift) {
    const { tool } = this.editor;
    if (tool === "move") {
      this.editor.move(x ? 0 : 1, x || y);
      this.changed(true);
    } else if (tool === "path" && shift) this.drawOn([x, y, 0]);
    else this.focus(this.focused[0] + x, this.focused[1] + y).focus();
  }

  // Extend the path from its drawn end in a direction, and focus the new end.
  /** @param {number[]} by */
  drawOn(by) {
    const head = this.editor.drawOn(by, this.focusedKey);
    const [x, y] = head === null ? this.focused : cellOf(head, this.size);
    this.focus(x, y).focus({ preventScroll: true });
    this.changed(true);
  }
}
