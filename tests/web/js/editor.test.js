import assert from "node:assert/strict";
import { test } from "node:test";
import { keyOf } from "../../../web/static/js/editor/painting.js";
import { letterCells } from "../../../web/static/js/editor/letters.js";
import { bounds } from "../../../web/static/js/editor/shape_tools.js";
import { Editor } from "../../../web/static/js/editor/state.js";

const key = (x, y, z = 0) => keyOf(x, y, z, 10);
function painted(count, conversion = "no", maxModules = 200) {
  const editor = new Editor(maxModules);
  editor.draft.note({ conversion });
  editor.step(() =>
    editor.painting.paint(
      Array.from({ length: count }, (_, y) => key(0, y)),
      true,
    ),
  );
  return editor;
}
const summary = ({ standing: { text, tone, limit, ready, completable } }) => [
  text,
  tone,
  limit,
  ready,
  completable,
];

test("the editor says what would be folded, and what is wrong with it", () => {
  assert.deepEqual(summary(painted(0)), ["", "", "", false, false]);
  assert.deepEqual(summary(painted(2)), ["16 modules", "", "Limit: 200 modules.", true, true]);
  assert.deepEqual(summary(painted(2, "yes")), [
    "2 modules. A fold needs at least 8.",
    "",
    "Limit: 200 modules.",
    false,
    true,
  ]);
  assert.deepEqual(summary(painted(9, "no", 64)), [
    "The shape needs 72 modules, but the limit is 64. Paint fewer cells.",
    "bad",
    "",
    false,
    false,
  ]);
  const apart = painted(2);
  apart.step(() => apart.painting.paint([key(5, 5)], true));
  assert.deepEqual(summary(apart), [
    "The shape has 2 separate pieces. Connect them face to face.",
    "bad",
    "Limit: 200 modules.",
    false,
    true,
  ]);
});

test("your own path is ready when it visits all cells", () => {
  const editor = painted(4, "path");
  assert.deepEqual(summary(editor), [
    "No path yet. Choose the tool Path and drag from cell to cell.",
    "",
    "4 modules. Limit: 200 modules.",
    false,
    true,
  ]);
  editor.step(() => editor.follow({ path: [0, 1, 2, 3].map((y) => key(0, y)), atStart: false }));
  assert.deepEqual(summary(editor), [
    "The path visits all 4 cells.",
    "good",
    "4 modules. Limit: 200 modules.",
    true,
    false,
  ]);
  assert.ok(editor.standing.complete);
});

test("the path is shown when its tool or its option is chosen", () => {
  const editor = painted(2);
  assert.equal(editor.shownPath, null);
  editor.take("path"); // also selects your own path
  assert.deepEqual(
    [editor.draft.conversion, editor.shownPath],
    ["path", { path: [], atStart: false }],
  );
  editor.take("paint");
  assert.ok(editor.shownPath);
  editor.choose("yes");
  assert.deepEqual([editor.tool, editor.shownPath], ["paint", null]);
  editor.choose("path"); // takes the tool that draws it
  assert.equal(editor.tool, "path");
  editor.choose("no");
  assert.equal(editor.tool, "paint");
});

test("letters are written beside each other as one connected word", () => {
  const editor = painted(0, "no", 400);
  const drawn = () => {
    const { size, cells } = editor.painting;
    return Array.from({ length: 5 }, (_, x) =>
      Array.from({ length: size }, (_none, y) =>
        cells[keyOf(x + top, y, 0, size)] ? "#" : " ",
      ).join(""),
    );
  };
  let top = 2;
  for (const letter of "LO") editor.write(letter, letterCells(letter));
  assert.equal(editor.painting.size, 16);
  top = bounds(editor.painting.state).low[0];
  assert.deepEqual(
    drawn().map((row) => row.trim()),
    ["#     #####", "#     #   #", "#     #   #", "#     #   #", "###########"],
  );
  assert.deepEqual([editor.name, editor.standing.ready], ["LO", true]);
  for (const letter of "OP") editor.write(letter, letterCells(letter));
  assert.deepEqual(
    [editor.name, editor.painting.size, editor.standing.tone],
    ["LOOP", 24, "bad"],
    "more modules than the limit of this service",
  );
  editor.write("S", letterCells("S"));
  const full = editor.painting.filled;
  editor.write("Q", letterCells("Q"));
  assert.match(editor.refused, /no room/);
  assert.equal(editor.painting.filled, full);
  editor.painting.undo();
  assert.equal(bounds(editor.painting.state).high[1] - bounds(editor.painting.state).low[1], 22);
  editor.draft.note({ name: "Mine" });
  editor.write("Z", letterCells("Z"));
  assert.equal(editor.name, "Mine");
});

test("a layer is copied from the one below, if there is one", () => {
  const editor = painted(3);
  editor.turn(1);
  editor.repeat();
  assert.ok([0, 1, 2].every((y) => editor.painting.cells[key(0, y, 1)]));
  editor.turn(99);
  assert.equal(editor.layer, 9);
  editor.turn(-1);
  assert.equal(editor.layer, 0);
});

test("a letter names the shape, a file gives the cells and their order", () => {
  const editor = painted(0);
  editor.turn(4);
  editor.write("T", [
    [0, 0],
    [0, 1],
    [0, 2],
  ]);
  assert.deepEqual(
    [editor.name, editor.layer, editor.painting.filled, editor.painting.cells[key(2, 2)]],
    ["Letter T", 0, 3, 1],
  );
  editor.draft.note({ name: " Duck/1 " });
  assert.deepEqual([editor.name, editor.fileName("path.json")], ["Duck/1", "Duck1.path.json"]);
  editor.clear();
  assert.deepEqual([editor.painting.filled, editor.name], [0, "Duck/1"]);
  const large = { size: 10, cells: new Uint8Array(1000).fill(1, 0, 30), path: [] };
  editor.open(large, "Slab", false); // 240 modules of blocks would be too many
  assert.deepEqual(
    [editor.draft.conversion, editor.name, editor.painting.filled],
    ["yes", "Slab", 30],
  );
  editor.resize(16);
  assert.deepEqual([editor.painting.size, editor.painting.filled], [16, 30]);
  editor.step(() => editor.painting.paint([keyOf(15, 15, 15, 16), keyOf(0, 0, 0, 16)], true));
  editor.resize(10);
  assert.match(editor.refused, /larger than this grid/);
});
