import assert from "node:assert/strict";
import { test } from "node:test";
import {
  checked,
  cut,
  extended,
  neighbours,
  nextCells,
  through,
  pathText,
  touch,
} from "../../../web/static/js/editor/cell_path.js";
import { cellOf, keyOf, keysOf } from "../../../web/static/js/editor/painting.js";
import { box } from "../../../web/static/js/editor/shape_tools.js";
import { Editor } from "../../../web/static/js/editor/state.js";
import { random, vectors } from "./vectors.js";

const SIZE = 10;
const key = (x, y, z = 0) => keyOf(x, y, z, SIZE);
const row = (count) => Array.from({ length: count }, (_, y) => key(0, y));

function painted(keys, path = []) {
  const cells = new Uint8Array(SIZE ** 3);
  for (const k of keys) cells[k] = 1;
  return { size: SIZE, cells, path };
}

test("neighbours share a face, and none lies beyond the edge", () => {
  for (let k = 0; k < SIZE ** 3; k++) {
    const [x, y, z] = cellOf(k, SIZE);
    const near = neighbours(k, SIZE);
    assert.equal(near.length, 6 - [x, y, z].filter((v) => v === 0 || v === SIZE - 1).length);
    for (const neighbour of near) {
      const [i, j, l] = cellOf(neighbour, SIZE);
      assert.equal(Math.abs(i - x) + Math.abs(j - y) + Math.abs(l - z), 1);
    }
  }
});

test("a path is whole when it visits all cells, each once, from face to face", () => {
  const square = [key(0, 0), key(0, 1), key(1, 1), key(1, 0)];
  const report = checked(painted(square, square));
  assert.ok(report.complete);
  assert.deepEqual(pathText(report), { text: "The path visits all 4 cells.", tone: "good" });
  assert.deepEqual(checked(painted(square, square.slice(0, 3))).missing, [key(1, 0)]);
  assert.deepEqual(
    checked(painted(square, [square[0], square[2], square[1], square[3]])).gaps,
    [0, 2],
  );
  const twice = checked(painted(square, [...square, square[0]]));
  assert.deepEqual(twice.repeats, [[0, 4]]);
  assert.equal(
    pathText(twice).text,
    "Cells 1 and 5 of the path are the same cell. A path visits each cell only once.",
  );
  assert.equal(checked(painted(row(2), row(2))).complete, false); // a chain needs a joint
  assert.match(pathText(checked(painted(row(2), row(2)))).text, /needs at least 3/);
  assert.match(
    pathText(checked(painted(row(4), [key(0, 0), key(0, 1), key(0, 3)]))).text,
    /^Cells 2 and 3 do not touch/,
  );
});

test("a path that the editor calls complete is one for the planner too", () => {
  for (const { cells, code } of vectors.paths) {
    const path = cells.map((cell) => key(...cell));
    const report = checked(painted(path, path));
    const problem =
      path.length < 3
        ? "too-few-cells"
        : report.repeats.length
          ? "repeated-cell"
          : report.gaps.length
            ? "not-adjacent"
            : null;
    assert.deepEqual([problem, report.complete], [code, code === null]);
  }
});

test("the editor says while you draw that a shape can have no path", () => {
  // One cell of a colour, five of the other.
  const star = [key(5, 5), ...neighbours(key(5, 5), SIZE)];
  const none = checked(painted(star));
  assert.equal(none.difference, 4);
  assert.match(pathText(none).text, /^No path yet\. No path visits all cells:/);
  const passedBy = checked(painted(row(6), [key(0, 2), key(0, 3)]));
  assert.deepEqual([passedBy.missing.length, passedBy.lost], [4, []]); // both ends can continue
  const oneSided = checked(painted(row(6), [key(0, 0), key(0, 1)]));
  assert.deepEqual(oneSided.lost, []);
  const apart = checked(painted([...row(3), key(5, 6)], row(3)));
  assert.deepEqual(apart.lost, [key(5, 6)]);
  assert.match(pathText(apart).text, /can no longer reach 1 of the remaining cells/);
});

test("a path grows at its ends, removes its last cell, and closes a gap", () => {
  const drawn = { path: row(3), atStart: false };
  assert.deepEqual(extended({ path: [], atStart: true }, 7, SIZE), { path: [7], atStart: false });
  assert.deepEqual(extended(drawn, key(1, 2), SIZE), {
    path: [...row(3), key(1, 2)],
    atStart: false,
  });
  assert.deepEqual(extended(drawn, key(1, 0), SIZE), {
    path: [key(1, 0), ...row(3)],
    atStart: true,
  });
  assert.deepEqual(extended(drawn, key(0, 1), SIZE), { path: row(2), atStart: false });
  assert.deepEqual(extended({ ...drawn, atStart: true }, key(0, 1), SIZE), {
    path: row(3).slice(1),
    atStart: true,
  });
  // The other end is used.
  assert.deepEqual(extended(drawn, key(0, 0), SIZE), { ...drawn, atStart: true });
  assert.match(
    extended({ path: row(5), atStart: false }, key(0, 1), SIZE),
    /This is already cell 2 of the path/,
  );
  assert.match(extended(drawn, key(5, 5), SIZE), /share a face/);
  const torn = { path: [key(0, 0), key(0, 1), key(0, 3)], atStart: false };
  assert.deepEqual(extended(torn, key(0, 2), SIZE).path, row(4));
  assert.deepEqual(nextCells(drawn, SIZE).sort(), [key(0, 3), key(1, 2), key(0, 2, 1)].sort());
  assert.deepEqual(cut({ path: row(5), atStart: false }, key(0, 1)).path, row(2));
  assert.deepEqual(cut({ path: row(5), atStart: true }, key(0, 1)).path, row(5).slice(1));
});

test("a path drawn by hand has no gaps or repeated cells, and can be undone", () => {
  const editor = new Editor(12_000);
  const { painting } = editor;
  editor.take("path");
  for (let k = 0; k < 190; k++) {
    const near = painting.path.length ? neighbours(painting.path.at(random(2) - 1), SIZE) : [444];
    const cell = random(6) ? near[random(near.length)] : random(SIZE ** 3);
    editor.press(cell);
    editor.lift(random(9) > 0);
    const report = checked(painting.state);
    assert.deepEqual(
      [report.gaps, report.repeats, report.missing.length > 0],
      [[], [], report.length < report.cells],
    );
  }
  assert.ok(painting.path.length > 10);
  while (painting.undo()) assert.deepEqual(checked(painting.state).gaps, []);
  assert.deepEqual([painting.path, painting.filled], [[], 0]);
});

test("one finger draws, fills and moves; a second finger cancels it", () => {
  const editor = new Editor(12_000);
  const { painting } = editor;
  const press = (...keys) => {
    editor.press(keys[0]);
    if (keys.length > 1) editor.drag(keys.slice(1));
    editor.lift(true);
  };
  editor.take("box");
  press(key(1, 1), key(2, 2));
  assert.equal(painting.filled, 4);
  press(key(4, 4));
  assert.equal(painting.filled, 4);
  press(key(5, 5, 3));
  assert.equal(painting.filled, 4 + 16);
  press(key(4, 4));
  press(key(5, 5, 3)); // starts at a painted cell, so it removes
  assert.deepEqual(keysOf(painting.cells), box(key(1, 1), key(2, 2), SIZE));
  editor.take("move");
  press(key(0, 0), key(3, 1), key(9, 9));
  assert.deepEqual(keysOf(painting.cells), box(key(8, 8), key(9, 9), SIZE));
  assert.equal(painting.done.length, 4);
  editor.take("fill");
  editor.press(key(0, 0));
  assert.equal(painting.filled, 100);
  editor.lift(false);
  assert.equal(painting.filled, 4);
  editor.axes.add(1);
  editor.take("paint");
  press(key(0, 0));
  assert.ok(painting.cells[key(0, 0)] && painting.cells[key(0, 9)]);
});

test("arrow keys extend the path from its head to the edge of the grid", () => {
  const editor = new Editor(12_000);
  const { painting } = editor;
  assert.equal(editor.drawOn([0, 1, 0], key(0, 0)), key(0, 0)); // the path starts at the cursor
  assert.equal(editor.drawOn([0, 1, 0], 999), key(0, 1));
  assert.equal(editor.drawOn([0, 0, 1], 999), key(0, 1, 1));
  assert.equal(editor.drawOn([-1, 0, 0], 999), key(0, 1, 1));
  assert.match(editor.refused, /grid ends here/);
  editor.reverse();
  assert.deepEqual([painting.path, editor.atStart], [[key(0, 1, 1), key(0, 1), key(0, 0)], true]);
  assert.equal(editor.drawOn([0, 1, 0], 999), key(0, 2, 1));
  editor.takeBack();
  assert.equal(painting.path[0], key(0, 1, 1));
});

test("a path through a few cells is found if there is one", () => {
  const cube = box(key(0, 0, 0), key(1, 1, 1), SIZE);
  for (const start of cube) {
    const path = through(cube, start, SIZE);
    assert.equal(new Set(path).size, 8);
    assert.ok(path[0] === start && path.slice(1).every((k, index) => touch(path[index], k, SIZE)));
  }
  assert.equal(through(row(3), key(0, 1), SIZE), null);
});
