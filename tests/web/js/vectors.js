// Python's results for these tests, written by tests/web/test_javascript.py, and their comparison.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { decode } from "../../../web/static/js/lib/columns.js";
import { Timeline } from "../../../web/static/js/player/timeline.js";

const path = process.env.FOLDBACK_VECTORS;
if (!path)
  throw new Error(
    "FOLDBACK_VECTORS names no file: run these by `pytest tests/web/test_javascript.py`",
  );
export const vectors = JSON.parse(readFileSync(path, "utf8"));

// Decode a message of web/timeline/columns.py from base64.
export const unpack = (text) => decode(new Uint8Array(Buffer.from(text, "base64")).buffer);

export function close(actual, expected, { atol = 1e-6, rtol = 0 } = {}) {
  assert.equal(actual.length, expected.length);
  for (let k = 0; k < actual.length; k++) {
    const off = Math.abs(actual[k] - expected[k]);
    assert.ok(
      off <= atol + rtol * Math.abs(expected[k]),
      `got ${actual[k]}, expected ${expected[k]} at ${k}`,
    );
  }
}

// Compare unit quaternions (4n) as rotations.
export function closeTurns(actual, expected, atol = 1e-6) {
  assert.equal(actual.length, expected.length);
  for (let k = 0; k < actual.length; k += 4) {
    const dot = [0, 1, 2, 3].reduce((sum, c) => sum + actual[k + c] * expected[k + c], 0);
    assert.ok(Math.abs(Math.abs(dot) - 1) <= atol, `turn ${k / 4} is another`);
  }
}

// Reproducible random integers from 0 to below a bound.
let state = 1;
export function random(bound) {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return Math.floor((state / 2 ** 32) * bound);
}

// Run all pending promises.
export const turnOfEvents = () =>
  new Promise((done) => {
    setImmediate(done);
  });

// Complete timeline of these vectors; `asked` counts its requests.
export async function recorded(recording = vectors.timeline) {
  const source = {
    asked: 0,
    bundle() {
      this.asked++;
      return unpack(recording.bundle);
    },
    batch() {
      this.asked++;
      return unpack(recording.batch);
    },
  };
  const timeline = new Timeline(source);
  while (!timeline.complete) await turnOfEvents();
  return { timeline, source };
}
