// The editor page: connects its controls with the draft, and requests previews and folds.
import { SIZES } from "../editor/painting.js";
import { imported } from "../editor/shape_tools.js";
import { Editor, MIN_MODULES } from "../editor/state.js";
import { Sheet, all, exact, say, showControls } from "../editor/view.js";
import { at, duration, element, get, later, save, integerText, wordsOf } from "../lib/text.js";

/** @typedef {import("../editor/state.js").Tool} Tool */
/** @typedef {0 | 1 | 2} Axis */

/** @type {{ most_modules: number }} */
const facts = JSON.parse(get("facts").textContent);
const CHECK_MS = 600;
const DRAW_MS = 150;
const MESH_CELLS = 160; // approximate default number of cells of a mesh

const editor = new Editor(facts.most_modules);
const { painting, draft } = editor;
const sheet = new Sheet(get("grid"), editor, (now) => {
  if (now) show();
  else soon();
});

// The drawing, the exchange of files and letters are loaded on first use.
const message = (/** @type {string} */ text) => say("message", text);
const picturing = later(() => import("../editor/isometric.js"), message);
const exchanging = later(
  () => import("../editor/exchange.js"),
  (text) => {
    editor.refused = text;
    show();
  },
);
const writing = later(() => import("../editor/letters.js"), message);

// Pointers move more often than frames are drawn. During a motion the grid is updated with every
// frame, but the drawing beside it, which may have thousands of faces, only every DRAW_MS.
let due = false;
let drawnAt = 0;
function soon() {
  if (due) return;
  due = true;
  requestAnimationFrame((now) => {
    if (due) show(now - drawnAt > DRAW_MS);
  });
}

function show(drawn = true) {
  due = false;
  editor.turn(editor.layer);
  const { layer, shownPath, standing } = editor;
  sheet.show();
  if (drawn) {
    if (standing.cells) picturing(({ draw }) => draw(get("model"), painting, layer, shownPath));
    drawnAt = performance.now();
  }
  showControls(editor, standing);
  check(standing.complete && standing.ready);
}

// Return a handler that acts and updates the page.
/** @param {() => void} act */
const doing = (act) => () => {
  act();
  show();
};

// Send a complete path to the service, which checks
// it for knots and estimates the time of the fold.
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;
let checkedPath = "";
/** @param {boolean} ready */
function check(ready) {
  const path = ready ? painting.path.join() : "";
  if (path === checkedPath) return;
  checkedPath = path;
  clearTimeout(timer);
  say("checked", "");
  if (!ready) return;
  const { state } = painting;
  timer = setTimeout(async () => {
    const words = await exchanging(({ report, pathFile }) =>
      report({ file: pathFile(editor.name, state), full: false }).then(
        ({ knot, expected_s: s }) =>
          knot?.verdict === "knotted"
            ? { text: "The path is knotted, so the chain cannot be pulled straight.", tone: "bad" }
            : {
                text: `Computing the fold takes ${duration(s)}.`,
                tone: "",
              },
        (error) => ({ text: wordsOf(error), tone: "bad" }),
      ),
    );
    if (path === checkedPath && words) say("checked", words.text, words.tone);
  }, CHECK_MS);
}

get("sheet").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase();
  const drawing = editor.tool === "path";
  const tool = [...all("[data-tool]")].find(({ dataset }) => dataset.key === key);
  if (tool) editor.take(/** @type {Tool} */ (tool.dataset.tool));
  else if (key === "escape" && editor.corner !== null) editor.corner = null;
  else if (drawing && key === "x") editor.cutAt(sheet.focusedKey);
  else if (drawing && (key === "backspace" || key === "delete")) editor.takeBack();
  else return;
  show();
  event.preventDefault();
});
addEventListener("keydown", (event) => {
  if (event.target instanceof Element && event.target.closest("input:not([type=radio]), select"))
    return;
  const command = event.ctrlKey || event.metaKey ? event.key.toLowerCase() : "";
  const by = Number(event.key === "PageUp") - Number(event.key === "PageDown");
  if (by && editor.tool === "path" && event.shiftKey) sheet.drawOn([0, 0, by]);
  else if (by) {
    if (editor.tool === "move") editor.move(2, by);
    editor.turn(editor.layer + by);
  } else if (command === "y" || (command === "z" && event.shiftKey)) painting.redo();
  else if (command === "z") painting.undo();
  else return;
  show();
  event.preventDefault();
});

get("up").onclick = doing(() => editor.turn(editor.layer + 1));
get("down").onclick = doing(() => editor.turn(editor.layer - 1));
get("undo").onclick = doing(() => painting.undo());
get("redo").onclick = doing(() => painting.redo());
get("clear").onclick = doing(() => editor.clear());
get("repeat").onclick = doing(() => editor.repeat());
for (const button of all("[data-tool]"))
  button.onclick = doing(() => editor.take(/** @type {Tool} */ (button.dataset.tool)));
for (const button of all("[data-both]")) {
  const axis = /** @type {Axis} */ (Number(button.dataset.both));
  button.onclick = doing(() => {
    if (!editor.axes.delete(axis)) editor.axes.add(axis);
    button.ariaPressed = String(editor.axes.has(axis));
  });
}
for (const button of all("[data-mirror]"))
  button.onclick = doing(() => editor.mirror(/** @type {Axis} */ (Number(button.dataset.mirror))));
for (const button of all("[data-move]")) {
  const [axis, by] = (button.dataset.move ?? "").split(" ").map(Number);
  button.onclick = doing(() => editor.move(/** @type {Axis} */ (axis), by));
}
get("higher").onclick = () => sheet.drawOn([0, 0, 1]);
get("lower").onclick = () => sheet.drawOn([0, 0, -1]);
get("cut").onclick = doing(() => editor.cutAt(sheet.focusedKey));
get("turn").onclick = doing(() => editor.reverse());
get("unpath").onclick = doing(() =>
  editor.step(() => {
    painting.path = [];
  }),
);
get("complete").onclick = async () => {
  const button = get("complete");
  button.ariaBusy = "true";
  button.textContent = "Searching…";
  message("");
  const [state, drawn] = [{ ...painting.state, cells: painting.cells.slice() }, editor.drawn];
  const completed = await exchanging((exchange) =>
    exchange.completed(state, drawn).catch((error) => new Error(wordsOf(error))),
  );
  button.ariaBusy = null;
  button.textContent = "Complete";
  // Keep a path that was changed meanwhile.
  if (completed === undefined || painting.path !== drawn.path) return;
  if (completed instanceof Error) editor.refused = completed.message;
  else if (completed) editor.step(() => editor.follow(completed));
  else
    editor.refused =
      "No path was found from this end through the remaining cells. Draw from the other end, or " +
      "cut the path and try again.";
  show();
};
for (const input of exact)
  input.addEventListener(
    "change",
    doing(() => editor.choose(/** @type {typeof draft.conversion} */ (input.value))),
  );
get("name").addEventListener("input", () => draft.note({ name: get("name").value }));
for (const button of /** @type {NodeListOf<HTMLElement>} */ (
  get("letters").querySelectorAll("button")
)) {
  const letter = button.textContent;
  button.onclick = () =>
    writing(({ letterCells }) => {
      editor.write(letter, letterCells(letter));
      show();
    });
}
for (const size of SIZES)
  get("size").append(element("option", { value: size }, `${size}×${size}×${size}`));
get("size").onchange = doing(() => editor.resize(Number(get("size").value)));

// Files.
let reading = 0;
/** @type {{ id: string, name: string } | null} */
let mesh = null;
/** @param {{ file: File } | { preview: string }} source */
async function open(source) {
  const turnOf = ++reading;
  const name = "file" in source ? source.file.name : (mesh?.name ?? "");
  say("reading", `Reading ${name}…`);
  const cells = Math.min(
    facts.most_modules,
    Math.max(MIN_MODULES, Math.round(Number(get("mesh-cells").value)) || MESH_CELLS),
  );
  get("mesh-cells").value = String(cells);
  try {
    const report = await exchanging(({ read }) => read(source, cells));
    if (turnOf !== reading) return;
    if (!report) {
      say("reading", "");
      return;
    }
    const ordered = report.kind === "path" || report.kind === "chain";
    editor.open(imported(report.cells, { ordered, least: SIZES[0] }), report.name, ordered);
    mesh = report.kind === "mesh" ? { id: report.id, name } : null;
    get("mesh-part").hidden = !mesh;
    if (ordered) editor.take("path");
    say(
      "reading",
      `${name}: ${integerText(report.cells.length)} cells${ordered ? " along their path" : ""}.`,
    );
  } catch (error) {
    if (turnOf === reading) say("reading", `${name}: ${wordsOf(error)}`, "bad");
  }
  show();
}
/** @param {FileList | null | undefined} files */
function openFirst(files) {
  if (files?.[0]) open({ file: files[0] });
}
get("open").onclick = () => get("file").click();
get("file").addEventListener("change", () => {
  openFirst(get("file").files);
  get("file").value = "";
});
get("mesh-cells").addEventListener("change", () => {
  if (mesh) open({ preview: mesh.id });
});
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  openFirst(event.dataTransfer?.files);
});
get("save-cells").onclick = () =>
  exchanging(({ voxelFile }) =>
    save(voxelFile(editor.name, painting.state), editor.fileName("voxels.json")),
  );
get("save-path").onclick = () =>
  exchanging(({ pathFile }) =>
    save(pathFile(editor.name, painting.state), editor.fileName("path.json")),
  );

// Send the shape. `ask` sends the file, reports a refusal, and returns true if the page is left.
/**
 * @param {(form: { file: File }, exchange: typeof
 *   import("../editor/exchange.js")) => Promise<boolean>} ask
 */
async function send(ask) {
  const {
    name,
    draft: { conversion },
  } = editor;
  editor.sending = true;
  show();
  const leaving = await exchanging((exchange) =>
    ask(
      {
        file:
          conversion === "path"
            ? exchange.pathFile(name, painting.state)
            : exchange.voxelFile(name, painting.state, conversion === "no"),
      },
      exchange,
    ),
  );
  if (leaving) return;
  editor.sending = false;
  show();
}
get("preview").onclick = () =>
  send(async (form, { report }) => {
    try {
      location.href = at((await report(form)).links.page);
      return true;
    } catch (error) {
      editor.refused = wordsOf(error);
      return false;
    }
  });
get("fold").onclick = () =>
  send((form, { openFold }) =>
    openFold(form, (words) => {
      editor.refused = words;
    }),
  );

get("mesh-cells").max = String(facts.most_modules);
sheet.build(painting.size);
addEventListener("pagehide", () => painting.leave());
addEventListener("pageshow", () => {
  editor.sending = false;
  show();
});
