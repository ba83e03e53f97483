import assert from "node:assert/strict";
import { test } from "node:test";
import { Painting, SIZES, cellsOf, keyOf, keysOf } from "../../../web/static/js/editor/painting.js";
import {
  bounds,
  box,
  imported,
  mirrored,
  moved,
  passed,
  region,
  resized,
  symmetric,
} from "../../../web/static/js/editor/shape_tools.js";
import { checked } from "../../../web/static/js/editor/cell_path.js";
import { random } from "./vectors.js";

const SIZE = 10;
const key = (x, y, z, size = SIZE) => keyOf(x, y, z, size);

function painted(cells, { path = [], size = SIZE } = {}) {
  const filled = new Uint8Array(size ** 3);
  for (const cell of cells) filled[key(...cell, size)] = 1;
  return { size, cells: filled, path: path.map((cell) => key(...cell, size)) };
}
const cells = ({ cells: filled, size }) => cellsOf(keysOf(filled), size);
const sample = (size) =>
  painted(
    Array.from({ length: 40 }, () => [random(size), random(size), random(size)]),
    { size },
  );

test("a region is connected by sides within one layer", () => {
  const ring = box(key(2, 2, 0), key(5, 5, 0), SIZE).filter(
    (k) => !box(key(3, 3, 0), key(4, 4, 0), SIZE).includes(k),
  );
  const painting = new Painting();
  painting.paint(ring, true);
  painting.paint([key(3, 3, 1)], true); // another layer is no wall
  assert.deepEqual(
    region(painting.state, key(3, 4, 0)).sort(),
    [key(3, 3, 0), key(3, 4, 0), key(4, 3, 0), key(4, 4, 0)].sort(),
  );
  assert.equal(region(painting.state, key(0, 0, 0)).length, 100 - 16);
  assert.deepEqual(region(painting.state, key(2, 2, 0)).sort(), ring.sort());
  assert.equal(region(painted([], { size: 32 }), 0).length, 1024);
});

test("a box lies between two cells in either order", () => {
  assert.equal(box(key(1, 2, 3), key(1, 2, 3), SIZE).length, 1);
  const keys = box(key(1, 5, 0), key(3, 4, 4), SIZE);
  assert.equal(new Set(keys).size, 3 * 2 * 5);
  assert.deepEqual(keys, box(key(3, 4, 4), key(1, 5, 0), SIZE));
});

test("a mirrored shape stays in place, and so does its path", () => {
  const path = [
    [1, 1, 0],
    [2, 1, 0],
    [2, 2, 0],
    [2, 2, 1],
  ];
  const mirrorImage = mirrored(painted(path, { path }), 0);
  assert.deepEqual(cellsOf(mirrorImage.path, SIZE), [
    [2, 1, 0],
    [1, 1, 0],
    [1, 2, 0],
    [1, 2, 1],
  ]);
  assert.deepEqual(bounds(mirrorImage), { low: [1, 1, 0], high: [2, 2, 1] });
  assert.ok(checked(mirrorImage).complete);
});

test("mirroring twice, or moving there and back, changes nothing", () => {
  for (let run = 0; run < 60; run++) {
    const before = sample(SIZES[random(SIZES.length)]);
    const { low, high } = bounds(before);
    const axis = random(3);
    const mirror = mirrored(before, axis);
    assert.deepEqual(bounds(mirror), { low, high });
    assert.deepEqual(mirrored(mirror, axis), before);
    const by = random(2 * before.size) - before.size;
    const shifted = moved(before, axis, by);
    const step = bounds(shifted).low[axis] - low[axis];
    assert.equal(step, Math.min(before.size - 1 - high[axis], Math.max(0 - low[axis], by)));
    assert.equal(cells(shifted).length, cells(before).length);
    assert.deepEqual(moved(shifted, axis, -step), before);
  }
});

test("symmetric painting gives a symmetric shape", () => {
  assert.deepEqual(symmetric([key(0, 3, 0)], SIZE, [1]), [key(0, 3, 0), key(0, 6, 0)]);
  for (let run = 0; run < 20; run++) {
    const keys = keysOf(sample(SIZE).cells);
    const axes = [0, 1, 2].filter(() => random(2));
    const keysBySymmetry = symmetric(keys, SIZE, axes);
    assert.equal(new Set(keysBySymmetry).size, keysBySymmetry.length);
    assert.deepEqual(symmetric(keysBySymmetry, SIZE, axes).sort(), keysBySymmetry.sort());
    assert.ok(keys.every((k) => keysBySymmetry.includes(k)));
  }
});

test("a resized grid has the shape in its middle, or is refused as too small", () => {
  const before = painted([
    [4, 4, 0],
    [5, 5, 3],
  ]);
  assert.deepEqual(cells(resized(before, 20)), [
    [9, 9, 0],
    [10, 10, 3],
  ]);
  assert.deepEqual(resized(resized(before, 20), 10), before);
  const long = painted(
    [
      [0, 3, 0],
      [15, 3, 0],
    ],
    { size: 16 },
  );
  assert.equal(resized(long, 10), null);
  assert.deepEqual(cells(resized(painted([[3, 3, 15]], { size: 16 }), 10)), [[0, 0, 9]]);
});

test("cells of a file get the smallest grid that holds them, in their order if they have one", () => {
  const painting = imported(
    [
      [-5, 100, 7],
      [-5, 101, 7],
      [-5, 101, 8],
    ],
    { ordered: true, least: 10 },
  );
  assert.deepEqual(cellsOf(painting.path, 10), [
    [4, 4, 0],
    [4, 5, 0],
    [4, 5, 1],
  ]);
  assert.equal(
    imported(
      [
        [0, 0, 0],
        [19, 0, 0],
      ],
      { ordered: false, least: 10 },
    ).size,
    20,
  );
  assert.deepEqual(imported([[0, 0, 0]], { ordered: false, least: 24 }).path, []);
  // Distant cells do not cause a huge grid.
  assert.throws(
    () =>
      imported(
        [
          [-1e6, 0, 0],
          [1e6, 0, 0],
        ],
        { ordered: false, least: 10 },
      ),
    /measures 2000001×1×1 cells, but the largest grid is 32×32×32/,
  );
  assert.throws(() => imported([], { ordered: false, least: 10 }), /has no cells/);
});

test("a quick pointer misses no cell on its way", () => {
  assert.deepEqual(passed([2, 2], [2, 2]), [[2, 2]]);
  for (let run = 0; run < 100; run++) {
    const [from, to] = [
      [random(32), random(32)],
      [random(32), random(32)],
    ];
    for (const bySides of [false, true]) {
      const way = passed(from, to, bySides);
      assert.deepEqual([way[0], way.at(-1)], [from, to]);
      for (let k = 1; k < way.length; k++) {
        const step = [0, 1].map((axis) => Math.abs(way[k][axis] - way[k - 1][axis]));
        assert.equal(bySides ? step[0] + step[1] : Math.max(...step), 1);
      }
    }
  }
});
