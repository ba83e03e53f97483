import assert from "node:assert/strict";
import { test } from "node:test";
import { radians } from "../../../web/static/js/lib/text.js";
import { colouring, colouringsOf, ramped, roundUp } from "../../../web/static/js/player/colours.js";
import { close, recorded, unpack, vectors } from "./vectors.js";

// Figures that tell the same of every frame.
const figuresOf = (modules, joints) => ({
  row: () => ({
    position_error: new Float32Array(modules).fill(0.02),
    torque: new Float32Array(joints).fill(-0.3),
    clearance: Float32Array.from({ length: modules }, (_, i) => (i === 3 ? -0.01 : 0.2)),
  }),
  lacking: null,
  largest: (name) => ({ position_error: 0.034, torque: 1.7 })[name],
});

test("colours of a ramp are the same as in Python", async () => {
  const { bundle, shares, errors } = vectors.colours;
  const { header, arrays } = await unpack(bundle);
  const found = ramped(Float64Array.from(shares, (v) => v ?? NaN), arrays.ramp_error, header.colours.unknown);
  assert.deepEqual([...found], errors);
});

test("colour scales end at the same values as in Python", () => {
  for (const [value, scale] of vectors.colours.scales) close([roundUp(value)], [scale], { rtol: 1e-9 });
  assert.equal(roundUp(0), 1);
});

test("every colouring has a scale in numbers", async () => {
  const { timeline } = await recorded();
  const shown = timeline.snapshot(timeline.last);
  const figures = figuresOf(timeline.chain.modules, timeline.joints);
  const told = {};
  const seen = {};
  for (const [key] of colouringsOf(false)) {
    const chosen = colouring(key, timeline, figures);
    seen[key] = chosen.of(shown);
    assert.equal(seen[key].length, 3 * timeline.chain.modules);
    told[key] = chosen.legend().high;
    assert.match(chosen.legend().ramp, /^linear-gradient\(to right, (rgb\(\d+ \d+ \d+\)(, |\)$)){9}/);
  }
  const { speed, error, ...others } = told;
  assert.deepEqual(others, {
    "error-even": error, position: "0.05 pitch", torque: "2 N·m", clearance: "0.5 pitch", chain: "Module 16",
  });
  assert.match(speed, /^[\d.]+ m?rad\/s$/);
  const scale = timeline.errorScale;
  assert.equal(error, radians(scale));
  // Red alone means error, or worse: two that overlap.
  const redness = (colours) => Array.from({ length: colours.length / 3 }, (_, i) => colours[3 * i] - Math.max(colours[3 * i + 1], colours[3 * i + 2]));
  assert.ok(Math.max(...redness(seen.error)) > 60);
  for (const key of ["error-even", "position", "torque", "speed", "chain"]) assert.ok(Math.max(...redness(seen[key])) < 60, key);
  assert.deepEqual([...seen.clearance.subarray(9, 12)], timeline.bundle.header.colours.error);
});

test("what is not measured yet is grey", async () => {
  const { timeline } = await recorded();
  const nothing = { row: () => null, largest: () => 0, lacking: null };
  const { unknown } = timeline.bundle.header.colours;
  for (const key of ["position", "torque", "clearance"]) {
    const colours = colouring(key, timeline, nothing).of(timeline.snapshot(0));
    assert.deepEqual([...colours.subarray(0, 3)], unknown, key);
  }
  assert.equal(colouring("clearance", timeline, nothing).legend().none, "no data yet");
  assert.equal(colouring("clearance", timeline, { ...nothing, lacking: "not here" }).legend().none, "not here");
  const { timeline: peeled } = await recorded(vectors.peeled);
  for (const key of ["torque", "clearance"]) assert.equal(colouring(key, peeled, nothing).legend().none, "only known for the whole chain");
  assert.equal(colouring("position", peeled, nothing).legend().none, "no data in this phase");
});
