import assert from "node:assert/strict";
import { test } from "node:test";
import { decode } from "../../../web/static/js/lib/columns.js";
import { Window } from "../../../web/static/js/player/frames.js";
import { Kinematics } from "../../../web/static/js/lib/kinematics.js";
import { close, closeTurns, unpack, vectors } from "./vectors.js";

for (const { name, bundle, batch, frames } of vectors.windows) {
  test(`poses of a window of ${name}`, async () => {
    const { header, arrays } = await unpack(bundle);
    const foldedRad = arrays.folded_rad;
    const kinematics = new Kinematics(header.chain, foldedRad);
    const noErrors = foldedRad.map(() => NaN);
    const rows = new Window(await unpack(batch), { foldedRad, noErrors });
    assert.equal("errors_rad" in rows.arrays, name === "cubes"); // the others were not simulated
    let [straight, folded, off] = [0, 0, 0];
    for (const { frame, poses } of frames) {
      const low = Math.floor(frame);
      let row = rows.row(low);
      if (frame > low) row = Window.between(row, rows.row(low + 1), frame - low);
      const { positions, wxyzs, core, rod } = Window.poses(kinematics, row);
      const expected = (await unpack(poses)).arrays;
      // Both ends are told in single precision, and the far one is far away.
      const length = expected.positions.reduce((most, v) => Math.max(most, Math.abs(v)), 1);
      close(positions, expected.positions, { atol: 1e-6 * length });
      closeTurns(wxyzs, expected.wxyzs);
      close(Float64Array.from(foldedRad, (_, j) => Window.angle(row, j)), expected.angles);
      assert.deepEqual([...row.errors].map(Number.isNaN), [...expected.errors].map(Number.isNaN));
      const known = expected.errors.some(Number.isNaN) ? [[], []] : [row.errors, expected.errors];
      close(...known, { atol: 1e-12, rtol: 1 / 256 });
      off = Math.max(off, ...known[1]);
      assert.ok(core >= 1 && core <= rod + 1 && rod + 1 <= header.chain.modules);
      straight = Math.max(straight, header.chain.modules - rod);
      folded = Math.max(folded, core);
    }
    assert.ok(straight > 100);
    assert.equal(off > 1e-3, name === "cubes");
    assert.equal(folded, header.chain.modules);
  });
}

test("packed columns", async () => {
  const { message, angles, errors } = vectors.columns;
  const { header, arrays } = await unpack(message);
  assert.deepEqual(header, { said: "ü" });
  assert.deepEqual([...arrays.plain], [0, 1, 2, 3, 4]);
  close(arrays.angles, angles, { atol: 6e-7 });
  const known = errors.flatMap((v, k) => (v === null ? [] : [k]));
  close(known.map((k) => arrays.errors[k]), known.map((k) => errors[k]), { rtol: 1 / 256 });
  assert.deepEqual([...arrays.errors].map(Number.isNaN), errors.map((v) => v === null));
});

test("a message that was cut short is refused", async () => {
  const whole = Buffer.from(vectors.columns.message, "base64");
  const half = new Uint8Array(whole.subarray(0, whole.length / 2));
  await assert.rejects(decode(half.buffer));
});
