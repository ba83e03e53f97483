import assert from "node:assert/strict";
import { test } from "node:test";
import { axes, csv } from "../../../web/static/js/panels/plots.js";

test("a plot as text has every frame, from 1 as on the page, and nothing where nothing is known", () => {
  assert.equal(csv("min_clearance", [0.25, NaN, -0.5]), "frame,min_clearance\n1,0.25\n2,\n3,-0.5");
});

test("axes have round values with their unit, and frames from 1", () => {
  const { up, across } = axes({ low: 0, high: 3.4e-5, frames: 1026, text: (v) => `${Math.round(v * 1e6)} µN·m` });
  assert.deepEqual(up.map(({ text }) => text), ["0 µN·m", "20 µN·m"]);
  assert.deepEqual(across.map(({ text }) => text), ["1", "500", "1\u2009000"]);
  assert.ok([...up, ...across].every(({ at }) => at >= 0 && at <= 1));
  assert.equal(axes({ low: 0, high: 0, frames: 1, text: String }).across.length, 1);
});
