// The editor: a grid for one layer, the painting behind it, and the way to a preview or a fold.
import { UNREACHABLE, askForFold } from "../lib/fold_request.js";
import { ownKey, proof } from "../lib/keys.js";
import { draw } from "../viewer/isometric.js";
import { LETTERS, letterCells } from "../viewer/letters.js";
import { Painting, SIZE, cellOf, keyOf } from "../viewer/painting.js";
import { element, get, refusal, whole } from "../lib/text.js";

/** @type {Record<string, [x: number, y: number]>} */
const ARROWS = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
const grid = get("grid");
const painting = new Painting();
let layer = 0;
/** @type {boolean | null} */
let filling = null;
/** @type {[x: number, y: number]} */
let focused = [Math.floor(SIZE / 2), Math.floor(SIZE / 2)];

grid.style.setProperty("--size", String(SIZE));
const squares = Array.from({ length: SIZE }, (_, x) => {
  const row = element("div", { role: "row" });
  grid.append(row);
  return Array.from({ length: SIZE }, (_none, y) => {
    const square = element("button", { type: "button", role: "gridcell", tabindex: "-1", "data-x": x, "data-y": y });
    row.append(square);
    return square;
  });
});

function show() {
  for (let x = 0; x < SIZE; x++) {
    for (let y = 0; y < SIZE; y++) {
      const square = squares[x][y];
      const on = painting.has(x, y, layer);
      const below = layer > 0 && painting.has(x, y, layer - 1);
      square.classList.toggle("on", on);
      square.classList.toggle("below", below);
      square.setAttribute("aria-selected", String(on));
      square.setAttribute("aria-label", `Row ${x + 1}, column ${y + 1}, ${on ? "filled" : "empty"}${below ? ", filled below" : ""}`);
    }
  }
  const cells = painting.cells.size;
  get("layer").textContent = `Layer ${layer + 1}`;
  get("down").disabled = layer === 0;
  get("up").disabled = layer === SIZE - 1;
  get("repeat").disabled = layer === 0;
  get("undo").disabled = !painting.done.length;
  get("redo").disabled = !painting.undone.length;
  get("clear").disabled = !cells;
  get("empty").hidden = cells > 0;
  draw(get("model"), painting, layer);
  const modules = cells * (doubled() ? 8 : 1);
  const pieces = painting.pieces();
  const few = modules > 0 && modules < 8;
  const count = get("count");
  count.dataset.tone = pieces > 1 ? "bad" : "";
  count.textContent = !cells ? "" : pieces > 1 ? `${pieces} pieces that do not touch: join them by faces.`
    : few ? `${whole(modules)} modules; a fold needs at least 8.` : `${whole(modules)} modules`;
  get("preview").disabled = get("fold").disabled = !cells || pieces > 1 || few;
}

const doubled = () => document.querySelector('[name="exact"][value="no"]:checked') !== null;

/** @param {number} to */
function turn(to) {
  layer = Math.min(SIZE - 1, Math.max(0, to));
  show();
}

/**
 * @param {number} x
 * @param {number} y
 */
function focus(x, y) {
  squares[focused[0]][focused[1]].tabIndex = -1;
  focused = [Math.min(SIZE - 1, Math.max(0, x)), Math.min(SIZE - 1, Math.max(0, y))];
  const square = squares[focused[0]][focused[1]];
  square.tabIndex = 0;
  return square;
}

/**
 * @param {number[]} keys
 * @param {boolean} filled
 */
function stroke(keys, filled) {
  painting.begin();
  for (const key of keys) painting.put(key, filled);
  painting.end();
  show();
}

// Painting with a pointer: the first cell says whether the stroke fills or empties.
/** @param {PointerEvent} event */
function paint(event) {
  const square = /** @type {HTMLElement | null | undefined} */ (document.elementFromPoint(event.clientX, event.clientY)?.closest("[data-x]"));
  if (!square || !grid.contains(square)) return;
  const [x, y] = [Number(square.dataset.x), Number(square.dataset.y)];
  filling ??= !painting.has(x, y, layer);
  focus(x, y);
  if (painting.put(keyOf(x, y, layer), filling)) show();
}
grid.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  painting.begin();
  paint(event);
  if (filling === null) { painting.stroke = null; return; }
  grid.setPointerCapture(event.pointerId);
});
grid.addEventListener("pointermove", (event) => { if (filling !== null) paint(event); });
function lift() {
  if (filling === null) return;
  filling = null;
  painting.end();
  squares[focused[0]][focused[1]].focus({ preventScroll: true });
  show();
}
grid.addEventListener("pointerup", lift);
grid.addEventListener("pointercancel", lift);

grid.addEventListener("keydown", (event) => {
  const by = ARROWS[event.key];
  if (by) {
    event.preventDefault();
    focus(focused[0] + by[0], focused[1] + by[1]).focus();
  } else if (event.key === " " || event.key === "Enter") {
    event.preventDefault();
    stroke([keyOf(...focused, layer)], !painting.has(...focused, layer));
  }
});
addEventListener("keydown", (event) => {
  if (event.target instanceof Element && event.target.closest("input[type=text]")) return;
  const command = event.ctrlKey || event.metaKey;
  if (event.key === "PageUp" || event.key === "PageDown") turn(layer + (event.key === "PageUp" ? 1 : -1));
  else if (command && event.key.toLowerCase() === "z") { if (event.shiftKey) painting.redo(); else painting.undo(); show(); }
  else if (command && event.key.toLowerCase() === "y") { painting.redo(); show(); }
  else return;
  event.preventDefault();
});

get("up").onclick = () => turn(layer + 1);
get("down").onclick = () => turn(layer - 1);
get("undo").onclick = () => { painting.undo(); show(); };
get("redo").onclick = () => { painting.redo(); show(); };
get("clear").onclick = () => { stroke([...painting.cells], false); turn(0); };
get("repeat").onclick = () => {
  stroke([...painting.cells].filter((key) => cellOf(key)[2] === layer - 1).map((key) => key + SIZE * SIZE), true);
};
for (const input of document.querySelectorAll('[name="exact"]')) input.addEventListener("change", show);
for (const letter of LETTERS) {
  const button = element("button", { type: "button", "aria-label": `Letter ${letter}` }, letter);
  button.onclick = () => {
    painting.begin();
    for (const key of [...painting.cells]) painting.put(key, false);
    const margin = Math.floor((SIZE - 5) / 2);
    for (const [x, y] of letterCells(letter)) painting.put(keyOf(x + margin, y + margin, 0), true);
    painting.end();
    get("name").value = `Letter ${letter}`;
    turn(0);
  };
  get("letters").append(button);
}

// Sending.
function file() {
  const name = get("name").value.trim() || "My shape";
  const voxels = { format: "foldback-voxels/1", name, cells: painting.voxels(doubled()) };
  return new File([JSON.stringify(voxels)], "painted.json", { type: "application/json" });
}

// `ask` sends the form and says why that could not be, or nothing.
/** @param {(form: FormData) => Promise<string>} ask */
async function send(ask) {
  const buttons = [get("preview"), get("fold")];
  for (const button of buttons) button.disabled = true;
  get("message").textContent = "";
  const form = new FormData();
  form.set("file", file());
  const refused = await ask(form);
  get("message").textContent = refused;
  for (const button of buttons) button.disabled = !refused;
}

/**
 * @param {FormData} form
 * @returns {Promise<string>}
 */
async function look(form) {
  try {
    const answer = await fetch("/api/shapes/preview", { method: "POST", body: form, headers: proof(ownKey()) });
    const told = await answer.json().catch(() => ({}));
    if (!answer.ok) return refusal(told, answer.status);
    location.href = told.links.page;
    return "";
  } catch {
    return UNREACHABLE;
  }
}
get("preview").onclick = () => send(look);
get("fold").onclick = () => send(askForFold);

focus(...focused);
show();
addEventListener("pageshow", (event) => { if (event.persisted) show(); });
