import assert from "node:assert/strict";
import { test } from "node:test";
import { Figures } from "../../../web/static/js/player/figures.js";
import { RefusedError } from "../../../web/static/js/player/timeline.js";
import { turnOfEvents } from "./vectors.js";

const BUSY = { status: 429, headers: new Headers({ "Retry-After": "3" }) };
const CURVES = { header: { frames: 2 }, arrays: { min_clearance: new Float32Array(2) } };

// Figures whose requests end with these results, one after the other, and the events so far.
function figuresOf(results) {
  const figures = new Figures("a");
  const events = [];
  for (const name of ["computing", "begun", "missing"]) figures.on(name, () => events.push(name));
  figures.get = async () => {
    const result = results.shift();
    if (result instanceof Error) throw result;
    return result;
  };
  return { figures, events };
}

test("plots wait until a busy service has computed them", async ({ mock: { timers } }) => {
  timers.enable({ apis: ["setTimeout"] });
  const { figures, events } = figuresOf([new RefusedError(BUSY), CURVES]);
  const begun = figures.begin();
  figures.begin();
  await turnOfEvents();
  assert.deepEqual([figures.pending, events], [true, ["computing"]]);
  timers.tick(2999);
  await turnOfEvents();
  assert.equal(figures.plots, null);
  timers.tick(1);
  await begun;
  assert.deepEqual([figures.pending, figures.plots.frames], [false, 2]);
  assert.deepEqual(events, ["computing", "begun"]);
});

test("a fold without figures has no plots, and is asked again when it changes", async () => {
  const { figures, events } = figuresOf([null, new TypeError("offline"), CURVES]);
  await figures.begin();
  await figures.begin();
  assert.deepEqual([figures.pending, figures.plots], [false, null]);
  await figures.begin();
  const pair = ["computing", "missing"];
  assert.deepEqual(events, [...pair, ...pair, "computing", "begun"]);
});
