import assert from "node:assert/strict";
import { test } from "node:test";
import { LETTERS, letterCells } from "../../../web/static/js/viewer/letters.js";
import { Painting, SIZE, cellOf, keyOf } from "../../../web/static/js/viewer/painting.js";

function stroke(painting, cells, filled = true) {
  painting.begin();
  for (const cell of cells) painting.put(keyOf(...cell), filled);
  painting.end();
}

test("strokes are undone and done again", () => {
  const painting = new Painting();
  stroke(painting, [[0, 0, 0], [1, 0, 0]]);
  stroke(painting, [[1, 0, 0]], false);
  stroke(painting, [[0, 0, 0]]); // changes nothing, and is no stroke
  assert.deepEqual(painting.voxels(false), [[0, 0, 0]]);
  assert.ok(painting.undo());
  assert.deepEqual(painting.voxels(false).sort(), [[0, 0, 0], [1, 0, 0]]);
  assert.ok(painting.redo());
  assert.equal(painting.redo(), false);
  assert.ok(painting.undo() && painting.undo());
  assert.equal(painting.undo(), false);
  assert.equal(painting.cells.size, 0);
});

test("cells hang together by faces, and not around the edge", () => {
  const painting = new Painting();
  stroke(painting, [[0, 0, 0], [0, 1, 0], [1, 2, 0], [0, SIZE - 1, 0]]);
  assert.equal(painting.pieces(), 3);
  stroke(painting, [[1, 1, 0]]);
  assert.equal(painting.pieces(), 2);
});

test("a cell doubled is a block of eight", () => {
  const painting = new Painting();
  stroke(painting, [[1, 2, 3]]);
  const block = painting.voxels(true);
  assert.equal(new Set(block.map(String)).size, 8);
  for (const cell of block) assert.deepEqual(cell.map((v) => v >> 1), [1, 2, 3]);
});

test("keys name cells", () => {
  for (const cell of [[0, 0, 0], [3, 7, 5], [SIZE - 1, SIZE - 1, SIZE - 1]]) assert.deepEqual(cellOf(keyOf(...cell)), cell);
});

test("every letter is one piece", () => {
  assert.equal(LETTERS.length, 26);
  for (const letter of LETTERS) {
    const painting = new Painting();
    stroke(painting, letterCells(letter).map(([row, column]) => [row, column, 0]));
    assert.equal(painting.pieces(), 1, letter);
  }
});
