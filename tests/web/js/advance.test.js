import assert from "node:assert/strict";
import { test } from "node:test";
import { Advance, queueWords } from "../../../web/static/js/panels/advance.js";

/** @param {[string, number, number][]} reports */
function after(reports) {
  const advance = new Advance();
  return reports.map(([stage, fraction, simulated_s]) => {
    advance.note({ stage, fraction, simulated_s });
    return [advance.fraction, advance.simulatedS, advance.attempt];
  });
}

test("progress of robots that take turns never runs backwards", () => {
  assert.deepEqual(after([["play_back", 0.3, 30], ["play_back", 0.2, 26], ["play_back", 0.4, 36]]), [
    [0.3, 30, 1], [0.3, 30, 1], [0.4, 36, 1],
  ]);
});

test("an earlier stage begins another attempt", () => {
  assert.deepEqual(after([["explode", 0.9, 0], ["play_back", 0.1, 5], ["explode", 0.06, 0]]).at(-1), [0.06, 0, 2]);
});

test("a fold that waits gives its reason", () => {
  assert.deepEqual([0, 1, 2, 4].map(queueWords), [
    "In the queue", "Next in line", "In the queue, behind 1 other fold", "In the queue, behind 3 other folds",
  ]);
});
