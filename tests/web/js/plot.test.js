import assert from "node:assert/strict";
import { test } from "node:test";
import { linePath, scaleOf, ticks } from "../../../web/static/js/lib/plot.js";
import { labels, layout } from "../../../web/static/js/panels/plan_choice.js";
import { axes, csv } from "../../../web/static/js/panels/plots.js";
import { frameIn } from "../../../web/static/js/player/bar.js";

/**
 * @param {number | null} time
 * @param {number | null} torque
 * @param {number | null} room also the number of hinges at once
 */
const plan = (time, torque, room) => ({
  ...{ label: "1. All at once", time_s: time, torque_mnm: torque, room, moving: room },
  ...{ cells: [], verified: true, chosen: false, stored: null },
});

test("ticks are round and between the ends, few of them", () => {
  assert.deepEqual(ticks(3, 22, false), [5, 10, 15, 20]);
  assert.deepEqual(ticks(0.0301, 0.0467, false), [0.035, 0.04, 0.045]);
  assert.deepEqual(ticks(0.07, 130, true), [0.1, 1, 10, 100]);
  assert.deepEqual(ticks(0.9, 6, true), [1, 2, 5]);
});

test("a quicker plan is on the left, one with more torque or room higher, all inside", () => {
  const plans = [plan(20, 0.1, 0.04), plan(10, 100, 0.03), plan(100, 1, 0.05)];
  for (const axis of /** @type {const} */ (["torque_mnm", "room", "moving"])) {
    const { dots, across, up } = layout(plans, axis);
    assert.ok(dots[1].x < dots[0].x && dots[0].x < dots[2].x);
    assert.ok(axis !== "torque_mnm" ? dots[1].y > dots[0].y : dots[1].y < dots[0].y);
    for (const { x, y } of dots) assert.ok(x > 40 && x < 336 && y > 0 && y < 190, `${x} ${y}`);
    for (const list of [across, up])
      assert.ok(list.length > 1 && list.every(({ at, text }) => Number.isFinite(at) && text));
  }
});

test("plans that lie close together share a label", () => {
  const at = (/** @type {number} */ x, /** @type {string} */ label) => ({
    x,
    y: 50,
    plan: { ...plan(1, 1, 1), label },
  });
  assert.deepEqual(
    labels([at(50, "1. All at once"), at(90, "2. Blocks first"), at(60, "4. Plan 1, smoothed")]),
    [
      { x: 60, y: 50, text: "1, 4" },
      { x: 90, y: 50, text: "2" },
    ],
  );
});

test("unknown figures have no dot; a single plan, or equal ones, can be drawn", () => {
  assert.equal(
    layout([plan(null, 1, 0.1), plan(3, null, 0.1), plan(3, 0, 0.1)], "torque_mnm").dots.length,
    0,
  );
  assert.equal(layout([plan(3, null, 0.1)], "room").dots.length, 1);
  const { dots, up } = layout([plan(3, 1, 0), plan(3, 1, 0)], "torque_mnm");
  assert.ok(dots.every(({ x, y }) => Number.isFinite(x) && Number.isFinite(y)));
  assert.ok(up.length > 0);
});

test("a plot as text lists every frame from 1, and nothing where nothing is known", () => {
  assert.equal(csv("min_clearance", [0.25, NaN, -0.5]), "frame,min_clearance\n1,0.25\n2,\n3,-0.5");
});

test("axes have round values with their unit, and frames from 1", () => {
  const { up, across } = axes({
    low: 0,
    high: 3.4e-5,
    frames: 1026,
    text: (v) => `${Math.round(v * 1e6)} µN·m`,
  });
  assert.deepEqual(
    up.map(({ text }) => text),
    ["0 µN·m", "10 µN·m", "20 µN·m", "30 µN·m"],
  );
  assert.deepEqual(
    across.map(({ text }) => text),
    ["1", "500", "1\u2009000"],
  );
  assert.ok([...up, ...across].every(({ at }) => at >= 0 && at <= 1));
  assert.equal(axes({ low: 0, high: 0, frames: 1, text: String }).across.length, 1);
});

test("a scale is linear or logarithmic, and a line has gaps where nothing is known", () => {
  const even = scaleOf([0, 10], [100, 0]);
  assert.deepEqual([0, 2.5, 10].map(even), [100, 75, 0]);
  assert.deepEqual([1, 10, 100].map(scaleOf([1, 100], [0, 8], true)), [0, 4, 8]);
  assert.equal(scaleOf([3, 3], [5, 9])(3), 5);
  assert.equal(
    linePath([0, 10, NaN, 5], (k) => k, even),
    "M0.0 100.0L1.0 0.0M3.0 50.0",
  );
});

test("a typed frame counts from 1, with or without a space; anything else is refused", () => {
  assert.deepEqual(
    ["1", " 240 ", "1 085", "1\u2009085"].map((text) => frameIn(text, 1085)),
    [0, 239, 1084, 1084],
  );
  for (const text of ["", "0", "1086", "-3", "2.5", "1e2", "12 s", "99999999999"])
    assert.equal(frameIn(text, 1085), null, text);
});
