import assert from "node:assert/strict";
import { test } from "node:test";
import { Follower, blended, distanceNeeded, framing, outward, positionOf } from "../../../web/static/js/viewer/camera.js";
import { clearestSight } from "../../../web/static/js/viewer/viewpoint.js";
import { close, unpack, vectors } from "./vectors.js";

const SOME = Float64Array.from({ length: 90 }, (_, k) => 5 * Math.sin(7.3 * k + k * k));
const SEEING = { radius: 0.9, aspect: 1.6, field: 0.56, home: -1, elevation: 0.4 };

for (const { name, points, seeing, azimuth, target, distance, needed, position } of vectors.camera) {
  test(`framing ${name}`, async () => {
    const { arrays } = await unpack(points);
    const view = framing(arrays.points, seeing);
    const found = [view.azimuth, ...view.target, view.distance, distanceNeeded(arrays.points, view, seeing), ...positionOf(view)];
    close(found, [azimuth, ...target, distance, needed, ...position], { rtol: 1e-6 });
  });
}

test("a following camera moves smoothly to its goal and stops there", () => {
  const from = framing(SOME, SEEING);
  const to = framing(SOME.map((v) => v + 30), { ...SEEING, azimuth: 3 });
  const follower = new Follower();
  follower.aim(from);
  follower.aim(to);
  let steps = 0;
  while (follower.move(1 / 30) && steps < 300) steps++;
  assert.ok(steps > 5 && steps < 300);
  assert.equal(follower.view, to);
  assert.equal(follower.move(1), false);
});

test("while the camera moves between two views, the whole chain stays in the picture", () => {
  const from = framing(SOME, SEEING);
  const to = framing(SOME.map((v) => v + 30), { ...SEEING, azimuth: 3 });
  const mixed = blended([from, to], [1, 1], from);
  close(mixed.target, from.target.map((v, k) => (v + to.target[k]) / 2));
  const aside = Math.hypot(...mixed.target.map((v, k) => v - from.target[k]));
  assert.ok(mixed.distance >= from.distance + aside);
});

test("the camera looks at modules from a side where nothing hides them", () => {
  // A module at the origin with walls on all sides except above.
  const wall = [];
  for (let k = 0; k < 64; k++) for (const z of [-1, 0, 1]) wall.push(2 * Math.cos((k * Math.PI) / 32), 2 * Math.sin((k * Math.PI) / 32), z);
  const positions = Float32Array.from([0, 0, 0, ...wall]);
  const [, rise] = clearestSight(positions, [0], [0.3, 0.1], outward);
  assert.equal(rise, 0.9);
  // If nothing is in the way, the camera stays.
  assert.deepEqual(clearestSight(positions.subarray(0, 3), [0], [0.3, 0.15], outward), [0.3, 0.15]);
});
