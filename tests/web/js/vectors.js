// What Python computed for these tests, and how it is compared; tests/web/test_javascript.py writes it.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { decode } from "../../../web/static/js/lib/columns.js";
import { Timeline } from "../../../web/static/js/player/timeline.js";

const path = process.env.FOLDBACK_VECTORS;
if (!path) throw new Error("FOLDBACK_VECTORS names no file: run these by `pytest tests/web/test_javascript.py`");
export const vectors = JSON.parse(readFileSync(path, "utf8"));

// A message of web/timeline/columns.py from its base64 text.
export const unpack = (text) => decode(new Uint8Array(Buffer.from(text, "base64")).buffer);

export function close(found, expected, { atol = 1e-6, rtol = 0 } = {}) {
  assert.equal(found.length, expected.length);
  for (let k = 0; k < found.length; k++) {
    const off = Math.abs(found[k] - expected[k]);
    assert.ok(off <= atol + rtol * Math.abs(expected[k]), `got ${found[k]}, expected ${expected[k]} at ${k}`);
  }
}

// Unit quaternions (4n) are the same turns.
export function closeTurns(found, expected, atol = 1e-6) {
  assert.equal(found.length, expected.length);
  for (let k = 0; k < found.length; k += 4) {
    const same = [0, 1, 2, 3].reduce((sum, c) => sum + found[k + c] * expected[k + c], 0);
    assert.ok(Math.abs(Math.abs(same) - 1) <= atol, `turn ${k / 4} is another`);
  }
}

// Whole numbers from 0 to below a bound, the same in every run.
let state = 1;
export function random(bound) {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return Math.floor((state / 2 ** 32) * bound);
}

// Lets all that was promised happen.
export const turnOfEvents = () => new Promise((done) => { setImmediate(done); });

// A timeline of these vectors, once all of it is there; `asked` counts what it asked for.
export async function recorded(given = vectors.timeline) {
  const source = {
    asked: 0,
    bundle() { this.asked++; return unpack(given.bundle); },
    batch() { this.asked++; return unpack(given.batch); },
  };
  const timeline = new Timeline(source);
  while (!timeline.complete) await turnOfEvents();
  return { timeline, source };
}
