import assert from "node:assert/strict";
import { test } from "node:test";
import {
  blended,
  distanceNeeded,
  fewPoints,
  framing,
  glided,
  membersOf,
  pieceOf,
  positionOf,
  valuesOf,
} from "../../../web/static/js/viewer/camera.js";
import { clearestSight } from "../../../web/static/js/viewer/viewpoint.js";
import { close, unpack, vectors } from "./vectors.js";

const SOME = Array.from({ length: 30 }, (_, i) =>
  [0, 1, 2].map((c) => 5 * Math.sin(7.3 * (3 * i + c) + (3 * i + c) ** 2)),
);
const MOVED = SOME.map((point) => point.map((v) => v + 30));
const SEEING = { radius: 0.9, aspect: 1.6, field: 0.56, home: -1, elevation: 0.4 };

for (const {
  name,
  points,
  seeing,
  azimuth,
  target,
  distance,
  needed,
  position,
} of vectors.camera) {
  test(`framing ${name}`, async () => {
    const { arrays } = await unpack(points);
    const sample = fewPoints(arrays.points);
    const view = framing(sample, seeing);
    const values = [
      view.azimuth,
      ...view.target,
      view.distance,
      distanceNeeded(sample, view, seeing),
      ...positionOf(view),
    ];
    close(values, [azimuth, ...target, distance, needed, ...position], { rtol: 1e-6 });
  });
}

test("a following camera moves smoothly to its goal and stops there", () => {
  const from = framing(SOME, SEEING);
  const to = framing(MOVED, { ...SEEING, azimuth: 3 });
  let view = from;
  let steps = 0;
  for (; view !== to && steps < 300; steps++) view = glided(view, to, 1 / 30);
  assert.ok(steps > 5 && steps < 300);
});

test("while the camera moves between two views, the whole chain stays in the picture", () => {
  const from = framing(SOME, SEEING);
  const to = framing(MOVED, { ...SEEING, azimuth: 3 });
  const mixed = blended([from, to], [1, 1], from);
  close(
    mixed.target,
    from.target.map((v, k) => (v + to.target[k]) / 2),
  );
  const offset = Math.hypot(...mixed.target.map((v, k) => v - from.target[k]));
  assert.ok(mixed.distance >= from.distance + offset);
});

test("the camera looks at modules from a side where nothing hides them", () => {
  // A module at the origin with walls on all sides except above.
  const wall = [];
  for (let k = 0; k < 64; k++)
    for (const z of [-1, 0, 1])
      wall.push(2 * Math.cos((k * Math.PI) / 32), 2 * Math.sin((k * Math.PI) / 32), z);
  const positions = Float32Array.from([0, 0, 0, ...wall]);
  const [, rise] = clearestSight(positions, [0], [0.3, 0.1]);
  assert.equal(rise, 0.9);
  // If nothing is in the way, the camera stays.
  assert.deepEqual(clearestSight(positions.subarray(0, 3), [0], [0.3, 0.15]), [0.3, 0.15]);
});

test("values of modules are shared out to the pieces that they are", () => {
  const pieces = {
    modules: 5,
    pieces: [
      [0, 1],
      [1, 3],
      [3, 4],
    ],
    pattern: [2, 0, 2],
  };
  assert.equal(pieceOf(pieces, 4), 0);
  const members = membersOf(pieces);
  assert.deepEqual(members, [
    [0, [1, 4]],
    [2, [0, 2, 3]],
  ]);
  const values = Float32Array.from({ length: 10 }, (_, k) => k);
  assert.deepEqual([...valuesOf(values, members[0][1], 2)], [2, 3, 8, 9]);
  assert.deepEqual([...valuesOf(values, members[1][1], 2)], [0, 1, 4, 5, 6, 7]);
  assert.equal(valuesOf(values, [0, 1, 2, 3, 4], 2), values);
});
