import assert from "node:assert/strict";
import { test } from "node:test";

// Stand-in for a browser.
globalThis.matchMedia = () => ({ matches: false, addEventListener() {} });
globalThis.document = { documentElement: { dataset: {} } };
const { Stage, discs } = await import("../../../web/static/js/viewer/stage.js");
const { tableColours } = await import("../../../web/static/js/viewer/sketch.js");
const { colouringFor, colouringsOf, withUnit } =
  await import("../../../web/static/js/player/colours.js");
const { recorded } = await import("./vectors.js");

test("the ground arrives below the chain, wherever it was and if its first step takes no time", () => {
  const snapshot = { positions: Float32Array.of(0, 0, -5, 0, 0, -9), framed: 1 };
  const grounds = [-1, -20].map((ground) => {
    const stage = Object.assign(Object.create(Stage.prototype), { ground, pitch: 1 });
    assert.ok(stage.moveGround(0, snapshot));
    while (stage.moveGround(0.05, snapshot)) assert.ok(stage.ground >= -20 && stage.ground <= -1);
    return stage.ground;
  });
  assert.equal(grounds[0], grounds[1]);
  assert.ok(grounds[0] < -5.5);
});

test("the area of a disc is the force, and modules without force have none", () => {
  const positions = [0, 0, 0, 1, 2, 0, 5, 5, 5, 7, 7, 7];
  const { places, scales } = discs([1, 4, NaN, 0], positions, -0.5, 0.25);
  assert.equal(scales[1], 2 * scales[0]);
  assert.deepEqual([scales[2], scales[3]], [0, 0]);
  assert.deepEqual([...places.subarray(3, 5)], [0.25, 0.5]);
  assert.ok(places[2] > -0.125 && places[2] < -0.115 && places[5] > places[2]);
  assert.ok(places[8] < -1e5 && places[11] < -1e5);
});

test("the table has the page's light or dark theme", () => {
  const dark = tableColours();
  document.documentElement.dataset.theme = "light";
  assert.ok(tableColours().top[0] > dark.top[0] + 100);
});

test("a fold on a table has other torques than one that floats", async () => {
  const keys = (table) => colouringsOf(table).map(([key]) => key);
  assert.deepEqual(
    keys(true).filter((key) => !keys(false).includes(key)),
    ["joint_torque", "pressed"],
  );
  assert.deepEqual(
    keys(false).filter((key) => !keys(true).includes(key)),
    ["torque"],
  );
  assert.equal(withUnit(4, 2.6487e-4), "4 w·p, 1.1 mN·m");
  const { timeline } = await recorded();
  const figures = {
    plots: { table: { unit_nm: 0.001, bound: 8, kept: 2, words: "without friction" } },
    largest: () => 3.2,
    row: () => ({
      joint_torque: new Float32Array(timeline.joints).fill(2),
      pressed: new Float32Array(timeline.chain.modules).fill(1),
    }),
  };
  const snapshot = timeline.snapshot(0);
  assert.equal(colouringFor("joint_torque", timeline, figures).legend().high, "3.2 w·p, 3.2 mN·m");
  assert.equal(
    colouringFor("pressed", timeline, figures).legend().high,
    "3.2 × the module’s weight",
  );
  const usual = colouringFor("chain", timeline, figures).of(snapshot);
  for (const key of ["joint_torque", "pressed"]) {
    assert.equal(
      colouringFor(key, timeline, figures).of(snapshot).length,
      3 * timeline.chain.modules,
    );
    assert.deepEqual(
      colouringFor(key, timeline, { ...figures, row: () => null }).of(snapshot),
      usual,
    );
  }
});
