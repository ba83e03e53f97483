// The editor: a grid for one layer, the tools, the drawing beside it, and the way to a preview or a fold.
import { checked, told } from "../editor/cell_path.js";
import { HINTS, Hand } from "../editor/hand.js";
import { Draft, Painting, SIZES, cellOf, keyOf, keysOf } from "../editor/painting.js";
import { imported, resized } from "../editor/shape_tools.js";
import { Sheet } from "../editor/sheet.js";
import { duration, element, get, later, whole, wordsOf } from "../lib/text.js";

/** @type {{ most_modules: number }} */
const facts = JSON.parse(get("facts").textContent);
const LEAST = 8;
/** @type {Record<string, string>} */
const HOW = {
  no: "Each cell becomes 2×2×2 modules. A path always exists.",
  yes: "Each cell becomes one module. Exact, but there may be no path.",
  path: "Each cell becomes one module, in the order you draw them.",
};
const CHECK_MS = 600;
const DRAW_MS = 150;
/** @type {Record<string, import("../editor/hand.js").Tool>} */
const KEYS = { p: "paint", f: "fill", b: "box", m: "move", d: "path" };

const painting = new Painting();
const draft = new Draft(() => localStorage);
const hand = new Hand(painting);
let layer = 0;
let sending = false;
let due = false;
let drawnAt = 0;
const sheet = new Sheet(get("grid"), {
  press: (key) => { hand.press(key); soon(); },
  drag: (keys) => { hand.drag(keys); soon(); },
  lift: (kept) => { hand.lift(kept); show(); },
  arrow: (by, shift) => {
    if (hand.tool === "move") { by.forEach((v, axis) => { if (v) hand.move(/** @type {0 | 1} */ (axis), v); }); show(); return true; }
    if (hand.tool !== "path" || !shift) return false;
    drawOn(by);
    return true;
  },
  bySides: () => hand.tool === "path",
});

const all = (/** @type {string} */ selector) => /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(selector));
const choice = () => /** @type {HTMLInputElement} */ (document.querySelector('[name="exact"]:checked')).value;

/** @param {string} value */
function choose(value) {
  const input = /** @type {HTMLInputElement | null} */ (document.querySelector(`[name="exact"][value="${value}"]`));
  if (input) input.checked = true;
  draft.note({ how: choice() });
}

// Show the stored name and choice; browsers fill in fields of their own after a reload.
function recall() {
  get("name").value = draft.name;
  choose(draft.how);
}

// Pointers move more often than pictures are drawn. While they do, the grid goes first: the drawing beside
// it, which may be of thousands of faces, follows now and then.
function soon() {
  if (due) return;
  due = true;
  requestAnimationFrame((now) => { if (due) show(now - drawnAt > DRAW_MS); });
}

function show(drawn = true) {
  due = false;
  layer = Math.min(painting.size - 1, layer);
  const drawing = hand.tool === "path" || choice() === "path" ? hand.drawn : null;
  sheet.show(painting.state, { layer, drawn: drawing, corner: hand.corner, axes: hand.axes });
  const cells = painting.filled;
  get("layer").textContent = `Layer ${layer + 1}`;
  get("down").disabled = layer === 0;
  get("up").disabled = layer === painting.size - 1;
  get("repeat").disabled = layer === 0;
  get("undo").disabled = !painting.done.length;
  get("redo").disabled = !painting.undone.length;
  get("clear").disabled = get("save-cells").disabled = !cells;
  get("cut").disabled = get("turn").disabled = get("unpath").disabled = !painting.path.length;
  get("size").value = String(painting.size);
  get("empty").hidden = cells > 0;
  if (drawn) {
    if (cells) picturing(({ draw }) => draw(get("model"), painting, layer, drawing));
    drawnAt = performance.now();
  }
  count(cells);
  say(hand.refused);
}

// What would be folded, and what is still wrong with it.
/** @param {number} cells */
function count(cells) {
  const how = choice();
  const found = how === "path" ? checked(painting.state) : null;
  const modules = cells * (how === "no" ? 8 : 1);
  const pieces = found ? 1 : painting.pieces();
  const path = found && cells ? told(found) : null;
  const large = modules > facts.most_modules;
  const few = !found && modules > 0 && modules < LEAST;
  let text = `${whole(modules)} modules`;
  if (!cells) text = "";
  else if (large) text = `${whole(modules)} modules are too many (at most ${whole(facts.most_modules)}). Paint fewer cells.`;
  else if (path) ({ text } = path);
  else if (pieces > 1) text = `The shape has ${pieces} separate pieces. Connect them face to face.`;
  else if (few) text = `${text}. A fold needs at least ${LEAST}.`;
  const tone = large || pieces > 1 ? "bad" : path?.tone ?? "";
  if (get("count").textContent !== text) get("count").textContent = text;
  get("count").dataset.tone = tone;
  get("most").textContent = large || !cells ? "" : `${path ? `${whole(modules)} modules. ` : ""}Limit: ${whole(facts.most_modules)} modules.`;
  get("how").textContent = HOW[how];
  get("save-path").hidden = !found?.whole;
  const ready = cells > 0 && !large && (found ? found.whole : pieces === 1 && !few);
  get("complete").disabled = !cells || Boolean(found?.whole) || large;
  get("preview").disabled = get("fold").disabled = !ready || sending;
  look(Boolean(found?.whole && ready));
}

// The drawing, what is sent, read and saved, and letters are loaded when they are used.
const picturing = later(() => import("../editor/isometric.js"), say);
const exchanging = later(() => import("../editor/exchange.js"), (text) => { hand.refused = text; show(); });
const writing = later(() => import("../editor/letters.js"), say);

/** @param {string} text */
function say(text) {
  if (get("message").textContent !== text) get("message").textContent = text;
}

const named = () => get("name").value.trim() || "My shape";

// A path that visits all cells is shown to the service as well, which tells knots.
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;
let shown = "";
/** @param {boolean} ready */
function look(ready) {
  const path = ready ? painting.path.join() : "";
  if (path === shown) return;
  shown = path;
  clearTimeout(timer);
  get("checked").textContent = "";
  if (!ready) return;
  const { state } = painting;
  timer = setTimeout(async () => {
    const said = await exchanging(({ asked, pathFile }) => asked({ file: pathFile(named(), state), full: false }).then(
      ({ knot, expected_s: s }) => (knot?.verdict === "knotted"
        ? { text: "The path is knotted, so the chain cannot be pulled straight.", tone: "bad" }
        : { text: `Folds in ${duration(s)}.`, tone: "" }),
      (error) => ({ text: wordsOf(error), tone: "bad" }),
    ));
    if (path !== shown || !said) return;
    get("checked").textContent = said.text;
    get("checked").dataset.tone = said.tone;
  }, CHECK_MS);
}

/** @param {number} to */
function turn(to) {
  layer = Math.min(painting.size - 1, Math.max(0, to));
  show();
}

/** @param {import("../editor/hand.js").Tool} tool */
function take(tool) {
  hand.take(tool);
  for (const button of all("[data-tool]")) button.ariaPressed = String(button.dataset.tool === tool);
  for (const options of all("[data-for]")) options.hidden = !options.dataset.for?.split(" ").includes(tool);
  const [hint, keys] = HINTS[tool];
  get("hint").replaceChildren(`${hint} `, element("span", { class: "keys" }, keys));
  if (tool === "path") choose("path");
  show();
}

/** @param {number[]} by */
function drawOn(by) {
  const head = hand.drawOn(by, sheet.focusedKey);
  if (head !== null) {
    const [x, y, z] = cellOf(head, painting.size);
    layer = z;
    sheet.focus(x, y).focus({ preventScroll: true });
  }
  show();
}

/** @param {() => void} act */
const stepped = (act) => () => { hand.step(act); show(); };

get("sheet").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const tool = KEYS[event.key.toLowerCase()];
  if (tool) take(tool);
  else if (event.key === "Escape" && hand.corner !== null) { hand.corner = null; show(); }
  else if (hand.tool === "path" && event.key.toLowerCase() === "x") { hand.cutAt(sheet.focusedKey); show(); }
  else if (hand.tool === "path" && ["Backspace", "Delete"].includes(event.key)) { hand.takeBack(); show(); }
  else return;
  event.preventDefault();
});
addEventListener("keydown", (event) => {
  if (event.target instanceof Element && event.target.closest("input:not([type=radio]), select")) return;
  const command = event.ctrlKey || event.metaKey;
  if (event.key === "PageUp" || event.key === "PageDown") {
    const by = event.key === "PageUp" ? 1 : -1;
    if (hand.tool === "path" && event.shiftKey) drawOn([0, 0, by]);
    else if (hand.tool === "move") { hand.move(2, by); turn(layer + by); }
    else turn(layer + by);
  } else if (command && event.key.toLowerCase() === "z") { if (event.shiftKey) painting.redo(); else painting.undo(); show(); }
  else if (command && event.key.toLowerCase() === "y") { painting.redo(); show(); }
  else return;
  event.preventDefault();
});

get("up").onclick = () => turn(layer + 1);
get("down").onclick = () => turn(layer - 1);
get("undo").onclick = () => { painting.undo(); show(); };
get("redo").onclick = () => { painting.redo(); show(); };
get("clear").onclick = () => {
  hand.step(() => painting.paint(keysOf(painting.cells), false));
  draft.clear();
  get("name").value = draft.name;
  turn(0);
};
get("repeat").onclick = stepped(() => {
  const area = painting.size ** 2;
  const below = keysOf(painting.cells).filter((key) => Math.floor(key / area) === layer - 1);
  painting.paint(below.map((key) => key + area), true);
});
for (const button of all("[data-tool]")) button.onclick = () => take(/** @type {import("../editor/hand.js").Tool} */ (button.dataset.tool));
for (const button of all("[data-both]")) {
  const axis = /** @type {0 | 1 | 2} */ (Number(button.dataset.both));
  button.onclick = () => {
    if (!hand.axes.delete(axis)) hand.axes.add(axis);
    button.ariaPressed = String(hand.axes.has(axis));
    show();
  };
}
for (const button of all("[data-mirror]")) button.onclick = () => { hand.mirror(/** @type {0 | 1 | 2} */ (Number(button.dataset.mirror))); show(); };
for (const button of all("[data-move]")) {
  const [axis, by] = (button.dataset.move ?? "").split(" ").map(Number);
  button.onclick = () => { hand.move(/** @type {0 | 1 | 2} */ (axis), by); show(); };
}
get("higher").onclick = () => drawOn([0, 0, 1]);
get("lower").onclick = () => drawOn([0, 0, -1]);
get("cut").onclick = () => { hand.cutAt(sheet.focusedKey); show(); };
get("turn").onclick = () => { hand.reverse(); show(); };
get("unpath").onclick = stepped(() => { painting.path = []; });
get("complete").onclick = async () => {
  const button = get("complete");
  button.ariaBusy = "true";
  button.textContent = "Searching…";
  say("");
  const [state, drawn] = [{ ...painting.state, cells: painting.cells.slice() }, hand.drawn];
  let refused = "";
  try {
    const found = await exchanging(({ completed }) => completed(state, drawn));
    if (found === undefined) return;
    // What was drawn meanwhile is not drawn over.
    if (painting.path !== drawn.path) return;
    if (found) hand.step(() => hand.follow(found));
    else refused = "Found no path from here through the remaining cells. Draw from the other end, or cut the path and try again.";
  } catch (error) {
    refused = wordsOf(error);
  } finally {
    button.ariaBusy = null;
    button.textContent = "Complete";
  }
  hand.refused = refused;
  show();
};
for (const input of all('[name="exact"]')) input.addEventListener("change", () => { draft.note({ how: choice() }); show(); });
get("name").addEventListener("input", () => draft.note({ name: get("name").value }));
for (const button of /** @type {NodeListOf<HTMLElement>} */ (get("letters").querySelectorAll("button"))) {
  const letter = button.textContent;
  button.onclick = () => writing(({ letterCells }) => {
    hand.step(() => {
      painting.paint(keysOf(painting.cells), false);
      const margin = Math.floor((painting.size - 5) / 2);
      painting.paint(letterCells(letter).map(([x, y]) => keyOf(x + margin, y + margin, 0, painting.size)), true);
    });
    draft.give(`Letter ${letter}`);
    get("name").value = draft.name;
    turn(0);
  });
}
for (const size of SIZES) get("size").append(element("option", { value: size }, `${size}×${size}×${size}`));
get("size").onchange = () => {
  const grid = resized(painting.state, Number(get("size").value));
  if (grid) hand.step(() => painting.become(grid));
  else hand.refused = "The shape is larger than this grid.";
  show();
};

// Files.
let reading = 0;
/** @type {{ id: string, name: string } | null} */
let mesh = null;
/** @param {{ file: File } | { preview: string }} source */
async function open(source) {
  const turnOf = ++reading;
  const name = "file" in source ? source.file.name : mesh?.name ?? "";
  const tell = (/** @type {string} */ text, tone = "") => {
    get("reading").textContent = text;
    get("reading").dataset.tone = tone;
  };
  tell(`Reading ${name}…`);
  const cells = Math.min(facts.most_modules, Math.max(LEAST, Math.round(Number(get("mesh-cells").value)) || 160));
  get("mesh-cells").value = String(cells);
  try {
    const report = await exchanging(({ read }) => read(source, cells));
    if (turnOf !== reading) return;
    if (!report) { tell(""); return; }
    const ordered = report.kind === "path" || report.kind === "chain";
    const found = imported(report.cells, { ordered, least: SIZES[0] });
    hand.step(() => painting.become(found));
    hand.atStart = false;
    mesh = report.kind === "mesh" ? { id: report.id, name } : null;
    get("mesh-part").hidden = !mesh;
    draft.give(report.name);
    get("name").value = draft.name;
    layer = 0;
    if (ordered) take("path");
    else if (choice() === "path" || 8 * report.cells.length > facts.most_modules) choose("yes");
    tell(`${name}: ${whole(report.cells.length)} cells${ordered ? " along their path" : ""}.`);
  } catch (error) {
    if (turnOf === reading) tell(`${name}: ${wordsOf(error)}`, "bad");
  }
  show();
}
get("open").onclick = () => get("file").click();
get("file").addEventListener("change", () => {
  const [file] = get("file").files ?? [];
  if (file) open({ file });
  get("file").value = "";
});
get("mesh-cells").addEventListener("change", () => { if (mesh) open({ preview: mesh.id }); });
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer?.files ?? [];
  if (file) open({ file });
});
const fileName = (/** @type {string} */ end) => `${named().replaceAll(/[^\p{L}\p{N} _-]+/gu, "").trim() || "shape"}.${end}`;
get("save-cells").onclick = () => exchanging(({ save, voxelFile }) => save(voxelFile(named(), painting.state), fileName("voxels.json")));
get("save-path").onclick = () => exchanging(({ save, pathFile }) => save(pathFile(named(), painting.state), fileName("path.json")));

// Sending. `ask` sends the file and says why that could not be, or nothing.
/** @param {(form: { file: File }, exchange: typeof import("../editor/exchange.js")) => Promise<string>} ask */
async function send(ask) {
  sending = true;
  const how = choice();
  show();
  const refused = await exchanging((exchange) => {
    const { pathFile, voxelFile } = exchange;
    return ask({ file: how === "path" ? pathFile(named(), painting.state) : voxelFile(named(), painting.state, how === "no") }, exchange);
  });
  if (refused === "") return; // the page is being left
  if (refused) hand.refused = refused;
  sending = false;
  show();
}
get("preview").onclick = () => send(async (form, { asked }) => {
  try {
    location.href = (await asked(form)).links.page;
    return "";
  } catch (error) {
    return wordsOf(error);
  }
});
get("fold").onclick = () => send((form, { askForFold }) => askForFold(form));

get("mesh-cells").max = String(facts.most_modules);
sheet.build(painting.size);
recall();
take("paint");
addEventListener("pageshow", () => { sending = false; recall(); show(); });
