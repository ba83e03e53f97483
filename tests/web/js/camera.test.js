import assert from "node:assert/strict";
import { test } from "node:test";
import {
  blended,
  distanceNeeded,
  fewPoints,
  framing,
  glided,
  positionOf,
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
