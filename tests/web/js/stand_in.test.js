// The page's drawing stands in for a 3D view that starts, is slow or restarts.
import assert from "node:assert/strict";
import { test } from "node:test";
import { recorded } from "./vectors.js";

globalThis.addEventListener ??= () => {};
globalThis.document ??= { documentElement: { dataset: {} } };
const { Stage } = await import("../../../web/static/js/viewer/stage.js");
const { StandIn } = await import("../../../web/static/js/viewer/stand_in.js");

const { timeline } = await recorded();
const EYE = { position: [9, 9, 9], target: [0, 0, 0] };
const COLOURS = new Uint8Array(3 * timeline.chain.modules);
const FAST_MS = 20;
const SLOW_MS = 100;
const REST_MS = 400;

class Classes extends Set {
  remove(...names) {
    for (const name of names) this.delete(name);
  }

  toggle(name, on) {
    if (on) this.add(name);
    else this.delete(name);
  }
}

// A view and a drawing under control of the test, and the test's clock.
function views({ mock }) {
  mock.timers.enable({ apis: ["setTimeout"] });
  let nowMs = 0;
  mock.method(performance, "now", () => nowMs);
  const frame = Object.assign(new EventTarget(), { classList: new Classes() });
  const canvas = { classList: new Classes() };
  const drawn = [];
  const sketch = { draw: (snapshot) => drawn.push(snapshot.frame) };
  const stage = new Stage(frame, {
    open: () => standIn.takeOver(),
    lost: () => standIn.fallBack(),
  });
  const standIn = new StandIn(canvas, stage, sketch);
  stage.set(timeline.bundle);
  const motion = { on: false };
  standIn.busy = () => motion.on;
  const pass = (ms) => {
    nowMs += ms;
    mock.timers.tick(ms);
  };
  return {
    stage,
    standIn,
    drawn,
    motion,
    pass,
    draw: (index) => standIn.draw(timeline.snapshot(index), COLOURS, EYE),
    // Let the view report all pictures that it was asked for.
    paint(ms = 0) {
      pass(ms);
      for (const id of [...stage.requests.keys()]) stage.hear({ is: "done", id });
    },
    // Let the drawing be painted.
    sketched: () => sketch.onDrawn(),
    open: () => stage.hear({ is: "open" }),
    lose: () => stage.hear({ is: "lost" }),
    classes: () => [...canvas.classList].sort().join(" "),
    hidden: () => frame.classList.has("behind"),
  };
}

// Views of which the 3D view has taken over and took some time for each of several pictures.
function opened(context, ms) {
  const all = views(context);
  all.draw(0);
  all.open();
  all.paint();
  for (let k = 0; k < 4; k++) {
    all.draw(k);
    all.paint(ms);
  }
  return all;
}

test("the drawing is visible until the view has painted its first picture", (context) => {
  const { standIn, stage, drawn, draw, open, paint, classes } = views(context);
  let opens = 0;
  standIn.onOpen = () => opens++;
  open();
  paint(); // there is no picture yet
  draw(0);
  draw(1);
  assert.deepEqual([drawn, classes(), opens, stage.requests.size], [[0, 1], "", 0, 1]);
  assert.equal(stage.latest[0].frame, 1);
  paint();
  assert.deepEqual([standIn.state.is, classes(), opens], ["viewing", "fading gone", 1]);
});

test("a fast view shows every motion itself", (context) => {
  const { standIn, stage, drawn, motion, draw, paint, classes } = opened(context, FAST_MS);
  motion.on = true;
  const before = drawn.length;
  draw(5);
  assert.equal(standIn.state.is, "viewing");
  paint(FAST_MS);
  assert.deepEqual([drawn.length, stage.latest[0].frame, classes()], [before, 5, "gone"]);
});

test("the drawing stands in for a slow view until nothing moves and the view has caught up", (context) => {
  const all = opened(context, SLOW_MS);
  const { standIn, stage, drawn, motion, draw, paint, pass, sketched, classes, hidden } = all;
  motion.on = true;
  draw(10);
  assert.deepEqual([drawn.at(-1), stage.latest[0].frame], [10, 3]);
  assert.ok(classes().includes("gone")); // the drawing still shows an earlier picture
  sketched();
  assert.deepEqual([classes(), hidden()], ["standing-in", true]);
  pass(REST_MS);
  assert.equal(standIn.state.is, "drawing"); // the motion goes on
  motion.on = false;
  pass(REST_MS - 1);
  draw(11);
  pass(REST_MS - 1);
  assert.equal(standIn.state.is, "drawing");
  pass(1);
  assert.deepEqual([standIn.state.is, stage.latest[0].frame, hidden()], ["yielding", 11, false]);
  draw(12); // before the view has painted
  paint();
  assert.deepEqual([standIn.state.is, classes()], ["drawing", "standing-in"]);
  pass(REST_MS);
  paint();
  assert.deepEqual([standIn.state.is, classes()], ["viewing", "fading gone"]);
  assert.equal(stage.latest[0].frame, 12);
});

test("a slow view through which the chain's path is visible shows the motion itself", (context) => {
  const { standIn, stage, drawn, draw, paint } = opened(context, SLOW_MS);
  draw(10);
  stage.seeThrough(true);
  draw(11);
  assert.deepEqual([standIn.state.is, drawn.at(-1), stage.latest[0].frame], ["yielding", 10, 11]);
  paint();
  assert.equal(standIn.state.is, "viewing");
});

test("a view that restarts takes over again only after its first picture", (context) => {
  const { standIn, stage, draw, paint, pass, sketched, open, lose, classes, hidden } = opened(
    context,
    SLOW_MS,
  );
  let opens = 0;
  standIn.onOpen = () => opens++;
  draw(10);
  sketched();
  lose();
  assert.deepEqual([standIn.state.is, classes(), hidden()], ["starting", "", false]);
  pass(REST_MS);
  assert.equal(standIn.state.is, "starting"); // the earlier motion's end changes nothing
  draw(11);
  open();
  assert.deepEqual([opens, stage.latest[0].frame], [0, 11]);
  lose(); // before its first picture
  open();
  draw(12);
  assert.equal(stage.latest[0].frame, 11); // the view is slow: one picture is enough
  paint();
  assert.deepEqual([opens, standIn.state.is, stage.latest[0].frame], [1, "yielding", 12]);
  paint();
  assert.deepEqual([opens, standIn.state.is, classes()], [1, "viewing", "fading gone"]);
  lose();
  assert.equal(classes(), "");
});
