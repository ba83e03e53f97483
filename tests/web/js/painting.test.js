import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { letterCells } from "../../../web/static/js/editor/letters.js";
import { visible } from "../../../web/static/js/editor/isometric.js";
import {
  Draft,
  MOST_STEPS,
  Painting,
  SIZES,
  cellOf,
  cellsOf,
  keyOf,
  keysOf,
  parts,
  unpacked,
} from "../../../web/static/js/editor/painting.js";
import { random } from "./vectors.js";

const SIZE = SIZES[0];
const key = (cell, size = SIZE) => keyOf(...cell, size);

function stroke(painting, cells, filled = true) {
  painting.begin();
  painting.paint(
    cells.map((cell) => key(cell)),
    filled,
  );
  return painting.end();
}
const cells = (painting) => cellsOf(keysOf(painting.cells), painting.size);

test("strokes are undone and redone", () => {
  const painting = new Painting();
  stroke(painting, [
    [0, 0, 0],
    [1, 0, 0],
  ]);
  stroke(painting, [[1, 0, 0]], false);
  assert.equal(stroke(painting, [[0, 0, 0]]), false); // no change, so no stroke
  assert.deepEqual(cells(painting), [[0, 0, 0]]);
  assert.ok(painting.undo());
  assert.deepEqual(cells(painting), [
    [0, 0, 0],
    [1, 0, 0],
  ]);
  assert.ok(painting.redo());
  assert.equal(painting.redo(), false);
  assert.ok(painting.undo() && painting.undo());
  assert.equal(painting.undo(), false);
  assert.equal(painting.filled, 0);
});

test("undo also restores the grid and the path, and a cancelled step leaves no trace", () => {
  const painting = new Painting();
  painting.begin();
  painting.draw(
    [
      [0, 0, 0],
      [0, 1, 0],
      [0, 2, 0],
    ].map((cell) => key(cell)),
  );
  painting.end();
  const { path } = painting;
  stroke(painting, [[0, 1, 0]], false); // emptied cells are not part of the path
  assert.deepEqual(painting.path, [0, 2]);
  painting.begin();
  painting.become({ size: 32, cells: new Uint8Array(32 ** 3), path: [] });
  painting.end();
  painting.undo();
  assert.deepEqual([painting.size, painting.path], [SIZE, [0, 2]]);
  painting.undo();
  assert.deepEqual([painting.path, painting.filled], [path, 3]);
  painting.begin();
  painting.paint([500], true);
  painting.cancel();
  assert.deepEqual([painting.path, painting.filled, painting.done.length], [path, 3, 1]);
});

test("any sequence of strokes can be undone, as far as steps are kept", () => {
  const painting = new Painting();
  const states = [[...painting.cells]];
  for (let k = 0; k < MOST_STEPS + 20; k++) {
    const keys = Array.from({ length: 1 + random(5) }, () => random(SIZE ** 3));
    painting.begin();
    painting.paint(keys, random(2) === 1);
    if (painting.end()) states.push([...painting.cells]);
  }
  assert.ok(painting.done.length <= MOST_STEPS);
  while (painting.undo()) {
    states.pop();
    assert.deepEqual([...painting.cells], states.at(-1));
  }
});

test("cells are connected by faces, not across the edge of the grid", () => {
  const painting = new Painting();
  stroke(painting, [
    [0, 0, 0],
    [0, 1, 0],
    [1, 2, 0],
    [0, SIZE - 1, 0],
  ]);
  assert.equal(parts(painting.cells, painting.size).length, 3);
  stroke(painting, [[1, 1, 0]]);
  assert.equal(parts(painting.cells, painting.size).length, 2);
});

test("doubling turns a cell into a block of eight", () => {
  const block = cellsOf([key([1, 2, 3])], SIZE, true);
  assert.equal(new Set(block.map(String)).size, 8);
  for (const cell of block)
    assert.deepEqual(
      cell.map((v) => v >> 1),
      [1, 2, 3],
    );
});

test("keys identify cells", () => {
  for (const size of SIZES) {
    for (const cell of [
      [0, 0, 0],
      [3, 7, 5],
      [size - 1, size - 1, size - 1],
    ])
      assert.deepEqual(cellOf(key(cell, size), size), cell);
  }
});

test("a stored drawing is restored as far as it is valid", () => {
  for (const nonsense of [null, [3, 4], { size: 1e9, filled: [1] }])
    assert.equal(unpacked(nonsense), null);
  for (const empty of [{ size: 10 }, { size: 10, filled: "no", path: 3 }])
    assert.deepEqual(keysOf(unpacked(empty).cells), []);
  const restored = unpacked({ size: 16, filled: [5, 6, -1, 16 ** 3, "7", 8.5], path: [5, 6, 7] });
  assert.deepEqual([restored.size, keysOf(restored.cells), restored.path], [16, [5, 6], [5, 6]]);
});

test("every letter is connected", () => {
  for (const letter of "ABCDEFGHIJKLMNOPQRSTUVWXYZ") {
    const painting = new Painting();
    stroke(
      painting,
      letterCells(letter).map(([row, column]) => [row, column, 0]),
    );
    assert.equal(parts(painting.cells, painting.size).length, 1, letter);
  }
});

test("a full cube shows three whole sides; of other cells, the nearest ones are seen", () => {
  const size = 6;
  const full = Array.from({ length: size ** 3 }, (_, k) => k);
  const faces = visible(full, size);
  assert.equal(faces.size, 3 * size ** 2);
  assert.ok([...faces.values()].every((halves) => halves === 3));
  assert.equal(visible([key([2, 2, 2], size)], size).size, 3);
  for (let run = 0; run < 20; run++) {
    const keys = full.filter(() => random(4) === 0);
    const sums = new Map(); // lines of sight: the nearest cell hides all others
    for (const k of keys) {
      const [x, y, z] = cellOf(k, size);
      const way = `${x - z} ${y - z}`;
      sums.set(way, Math.max(sums.get(way) ?? -1, x + y + z));
    }
    for (const face of visible(keys, size).keys()) {
      const [x, y, z] = cellOf(Math.floor(face / 3), size);
      assert.equal(x + y + z, sums.get(`${x - z} ${y - z}`));
    }
  }
});

// Draft without the cells.
/** @param {string | null} text that the browser stores */
function storing(text = null) {
  globalThis.localStorage = {
    getItem: () => text,
    setItem: (_, value) => {
      text = value;
    },
  };
}
const draftOf = ({ conversion, name }) => [conversion, name];
afterEach(() => {
  delete globalThis.localStorage;
  delete globalThis.sessionStorage;
});

test("the steps for undo and redo survive leaving the page, as far as they fit", () => {
  globalThis.localStorage = globalThis.sessionStorage = new (class {
    getItem(name) {
      return this[name] ?? null;
    }
    setItem(name, value) {
      this[name] = value;
    }
  })();
  const painting = new Painting();
  const step = (...keys) => {
    painting.begin();
    painting.paint(keys, true);
    painting.end();
  };
  step(1);
  step(2);
  painting.undo();
  painting.leave();
  const restored = new Painting();
  assert.deepEqual([restored.filled, restored.done.length, restored.undone.length], [1, 1, 1]);
  restored.redo();
  assert.equal(restored.filled, 2);
  painting.become({ size: 32, cells: new Uint8Array(32 ** 3).fill(1), path: [] });
  for (let k = 0; k < 9; k++) {
    painting.begin();
    painting.paint([k], false);
    painting.end();
  }
  painting.leave();
  assert.ok(sessionStorage["foldback:painting-steps"].length < 1_000_100);
  assert.equal(new Painting().done.length, 5);
  sessionStorage["foldback:painting-steps"] = '{"done":7}';
  assert.deepEqual([new Painting().filled > 0, new Painting().done], [true, []]);
});

test("a draft keeps its path and its name after a reload", () => {
  storing();
  new Draft().note({ conversion: "path", name: "Duck" });
  assert.deepEqual(draftOf(new Draft()), ["path", "Duck"]);
});

test("a draft is empty if nothing valid is stored", () => {
  for (const text of [null, "{", "null", '{"conversion":"all","name":7}']) {
    storing(text);
    assert.deepEqual(draftOf(new Draft()), ["no", ""]);
  }
});

test("a draft works without storage", () => {
  globalThis.localStorage = new Proxy(
    {},
    {
      get() {
        throw new Error("no storage");
      },
    },
  );
  const draft = new Draft();
  draft.note({ conversion: "yes" });
  assert.equal(draft.conversion, "yes");
});

test("clearing removes a generated name and keeps a typed one", () => {
  storing();
  new Draft().give("Letter A");
  const draft = new Draft();
  draft.clear();
  assert.equal(draft.name, "");
  draft.give("Letter B");
  draft.note({ name: "Slab" });
  draft.clear();
  assert.equal(draft.name, "Slab");
});
