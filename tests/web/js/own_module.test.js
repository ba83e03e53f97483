// Module files and chain files become one file.
import assert from "node:assert/strict";
import test from "node:test";

import { OwnModule } from "../../../web/static/js/lib/own_module.js";

const MODULE = {
  format: "foldback-module/1",
  name: "slab",
  pitch_m: 0.04,
  pieces: [{ joint: { hinges: [{ axis: [0, 0, 1] }] } }],
};
const CHAIN = { format: "foldback-chain/1", name: "bow", joint_angles_deg: [30, 0] };

/** @param {object | string} values */
const file = (values, name = "a.json") =>
  new File([typeof values === "string" ? values : JSON.stringify(values)], name);
/** @param {File | null} joined */
const valuesOf = async (joined) => JSON.parse((await joined?.text()) ?? "null");

test("a chain file gets the module that was dropped with it", async () => {
  for (const files of [
    [file(MODULE), file(CHAIN, "bow.json")],
    [file(CHAIN, "bow.json"), file(MODULE)],
  ]) {
    const joined = await new OwnModule().join(files);
    assert.equal(joined?.name, "bow.json");
    assert.deepEqual(await valuesOf(joined), { ...CHAIN, pitch_m: 0.04, module: MODULE });
  }
});

test("a chain file gets the module that was dropped before it", async () => {
  const own = new OwnModule();
  const alone = file(MODULE);
  assert.equal(await own.join([alone]), alone);
  assert.deepEqual((await valuesOf(await own.join([file(CHAIN)]))).module, MODULE);
  const named = file({ ...CHAIN, module: "cube" });
  assert.equal(await own.join([named]), named);
});

test("a module is shown as a straight chain", async () => {
  const own = new OwnModule();
  await own.join([file(MODULE)]);
  const shown = await valuesOf(own.straight());
  assert.deepEqual(shown.joint_angles_deg, [0, 0, 0, 0, 0, 0, 0]);
  const two = { ...MODULE, pieces: [{ joint: { hinges: [{}, {}] } }] };
  await own.join([file(two)]);
  assert.deepEqual((await valuesOf(own.straight())).joint_angles_deg[0], [0, 0]);
});

test("other files stay as they are, and two of them do not belong together", async () => {
  const own = new OwnModule();
  for (const text of ["solid a", "[[0,0,0]]", '{"format": "foldback-chain/1"', '{"a": 1}']) {
    const other = file(text);
    assert.equal(await own.join([other]), other);
    assert.equal(await own.join([other, file(CHAIN)]), null);
  }
  assert.equal(await own.join([file(MODULE), file(CHAIN), file(CHAIN)]), null);
});
