import assert from "node:assert/strict";
import { test } from "node:test";
import { partColours } from "../../../web/static/js/player/player_state.js";
import {
  extent,
  modulesInView,
  stepWords,
  stepsDone,
} from "../../../web/static/js/panels/steps.js";
import { isHidden } from "../../../web/static/js/viewer/viewpoint.js";

const steps = [
  [0, 10],
  [10, 30],
].map(([start, end], k) => ({ start, end, text: `Turn ${k}.`, joints: [k], moving: [[0, k]] }));

test("a step is done at its end", () => {
  assert.deepEqual(
    [0, 9, 10, 29, 30].map((frame) => stepsDone(steps, frame)),
    [0, 0, 1, 1, 2],
  );
  assert.deepEqual(stepWords(steps, 1), { count: "Step 2 of 2", text: "Turn 1." });
  assert.deepEqual(stepWords(steps, 2), { count: "All 2 steps", text: "The chain is folded." });
});

test("only the moving part and the joint have a colour", () => {
  const colours = partColours(
    4,
    { joints: [1], moving: [[0, 1]] },
    { calm: [1, 1, 1], moving: [2, 2, 2], joint: [3, 3, 3] },
  );
  assert.deepEqual([...colours], [2, 2, 2, 3, 3, 3, 1, 1, 1, 1, 1, 1]);
});

test("the extent is 1 at the edge of the free part of the picture", () => {
  const picture = { field: Math.PI / 2, aspect: 2, covered: 0.25 };
  const view = { target: [0, 0, 0], azimuth: 0, elevation: 0, distance: 10 };
  const near = (z, expected) =>
    assert.ok(Math.abs(extent([[0, 0, z]], view, picture) - expected) < 1e-9);
  near(10, 1); // the upper edge
  near(-5, 1); // the upper edge of what covers the lower quarter
  near(2.5, 0);
});

test("a module is hidden if another one is on the line of sight", () => {
  const positions = Float32Array.of(0, 0, 0, 2, 0, 0, 0, 5, 0);
  assert.equal(isHidden(positions, 0, [0, 0]), true);
  assert.equal(isHidden(positions, 1, [0, 0]), false);
  assert.equal(isHidden(positions, 0, [Math.PI, 0]), false);
});

test("long straight ends are outside of the picture", () => {
  const line = (count) => Float32Array.from({ length: 3 * count }, (_, k) => (k % 3 ? 0 : k / 3));
  const ends = (modules) => [modules[0], modules.at(-1), modules.length];
  assert.deepEqual(ends(modulesInView(line(160), [80])), [70, 90, 21]);
  assert.deepEqual(ends(modulesInView(line(160), [24, 25])), [14, 35, 22]);
  assert.deepEqual(ends(modulesInView(line(24), [6])), [0, 23, 24]);
  assert.deepEqual(ends(modulesInView(line(160), [])), [0, 159, 160]);
  const bent = line(160);
  for (let i = 121; i < 160; i++) bent.set([120, i - 120, 0], 3 * i);
  assert.deepEqual(ends(modulesInView(bent, [80])), [70, 130, 61]);
});
