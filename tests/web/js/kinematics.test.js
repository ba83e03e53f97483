import assert from "node:assert/strict";
import { test } from "node:test";
import { Kinematics, buriedBy, touching } from "../../../web/static/js/player/kinematics.js";
import { picked } from "../../../web/static/js/viewer/camera.js";
import { close, closeTurns, unpack, vectors } from "./vectors.js";

for (const { name, bundle, given } of vectors.kinematics) {
  test(`poses of ${name}`, async () => {
    const { header } = await unpack(bundle);
    const { angles, position, wxyz, positions, wxyzs } = (await unpack(given)).arrays;
    const poses = new Kinematics(header.chain).poses(angles, position, wxyz);
    close(poses.positions, positions, { atol: 2e-6 });
    closeTurns(poses.wxyzs, wxyzs);
  });
}

for (const { name, bundle, given, origin, ways, modules } of vectors.picking) {
  test(`the first of the ${name} that a ray hits`, async () => {
    const { header } = await unpack(bundle);
    const { arrays } = await unpack(given);
    assert.deepEqual(
      ways.map((way) => picked(header.chain, arrays, origin, way)),
      modules,
    );
  });
}

test("touching faces are found", async () => {
  const { bundle, beside, buried } = vectors.touching;
  const { header, arrays } = await unpack(bundle);
  const neighbours = touching(header, new Kinematics(header.chain, arrays.folded_rad).folded);
  const faces = neighbours.length / beside.length;
  assert.deepEqual(
    beside.map((_, i) =>
      [...neighbours.subarray(i * faces, (i + 1) * faces)].sort((a, b) => a - b),
    ),
    beside,
  );
  assert.deepEqual([...buriedBy(neighbours, header.chain.modules)], buried);
});
