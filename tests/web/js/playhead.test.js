import assert from "node:assert/strict";
import { test } from "node:test";
import { angleIn } from "../../../web/static/js/player/frames.js";
import { nameOf } from "../../../web/static/js/player/keys.js";
import { Playhead, after, nextChange } from "../../../web/static/js/player/playhead.js";
import { close, recorded, vectors } from "./vectors.js";

function head(last = 239, growing = false) {
  const playhead = new Playhead({ last, growing });
  const set = (options) => {
    playhead.do({ do: "set", ...options });
    return [playhead.is.from, playhead.is.to, playhead.is.loop];
  };
  return { playhead, set };
}

test("the ends of a loop stay in the timeline and cannot cross", () => {
  const { set } = head();
  assert.deepEqual(set({ from: 20 }), [20, null, true]);
  assert.deepEqual(set({ to: 60 }), [20, 60, true]);
  assert.deepEqual(set({ from: 80 }), [80, null, true]);
  assert.deepEqual(set({ to: 40 }), [null, 40, true]);
  assert.deepEqual(set({ to: 239 }), [null, null, true]); // it continues to loop, over all frames
  assert.deepEqual(head().set({ from: 0, to: 99_999_999 }), [null, null, false]);
  assert.deepEqual(head().set({ from: 99_999_999, to: 5 }), [null, 5, true]);
  // These frames may still arrive.
  assert.deepEqual(head(10, true).set({ from: 50, to: 80 }), [50, 80, true]);
});

test("a loop starts inside its part and continues at its beginning", () => {
  const { playhead, set } = head();
  set({ from: 100, to: 112 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 100);
  playhead.advance(0.5, 1);
  assert.equal(playhead.frame, 106); // 12 frames per second
  playhead.advance(2, 2);
  assert.deepEqual([playhead.frame, playhead.is.playing], [112, true]);
  playhead.advance(0.5, 5); // it has paused there
  assert.equal(playhead.frame, 100);
  playhead.do({ do: "seek", frame: 200 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 100);
  set({ reverse: true });
  playhead.do({ do: "seek", frame: 200 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 112);
  set({ loop: false, reverse: false }); // without a loop all is played, and the ends are kept
  playhead.do({ do: "seek", frame: 238 });
  playhead.do({ do: "play" });
  playhead.advance(1, 9);
  assert.deepEqual([playhead.frame, playhead.is.playing, playhead.is.to], [239, false, 112]);
});

test("there is no loop over frames that are not there yet", () => {
  const { playhead, set } = head(10, true);
  set({ from: 50, to: 80 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 0);
  playhead.timeline.last = 60;
  assert.deepEqual(playhead.range, [50, 60]);
});

// Frames of one hinge at these times; a time of null is a frame that has not arrived.
function timeline(times, angles = times.map(() => 0), phases = times.map(() => 0)) {
  const row = (k) =>
    times[k] === null || times[k] === undefined
      ? null
      : { time_s: times[k], phase: phases[k], first: 0, last: 1, angles: [angles[k]] };
  return { last: times.length - 1, row, joints: 1 };
}

test("a step in time may end between frames and stays in the timeline", () => {
  const uneven = timeline([0, 0.1, 0.1, 0.5, 1.5]);
  close(
    [after(uneven, 0, 0.05), after(uneven, 0, 0.3), after(uneven, 2.5, 0.2), after(uneven, 3, 9)],
    [0.5, 2.5, 3, 4],
  );
  close(
    [
      after(uneven, 4, -1),
      after(uneven, 3.5, -0.7),
      after(uneven, 2, -0.05),
      after(uneven, 0.5, -1),
    ],
    [3, 2.5, 0.5, 0],
  );
  for (const frame of [0.25, 1, 2.75])
    close([after(uneven, after(uneven, frame, 0.1), -0.1)], [frame === 1 ? 2 : frame]);
});

test("missing frames count as long as the last one in a step in time", () => {
  const partly = timeline([0, 0.1, null, null, null, null]);
  close(
    [after(partly, 0, 0.3), after(partly, 0, 60), after(partly, 3, 1), after(partly, 5, -1)],
    [3, 5, 4, 4],
  );
});

test("the next change is where a hinge has turned visibly, or another phase begins", () => {
  const angles = [0, 0.02, 0.04, 0.06, 0.06, 0.06, 0.06];
  const turns = timeline(
    angles.map((_, k) => k),
    angles,
    [0, 0, 0, 0, 0, 1, 1],
  );
  assert.deepEqual(
    [0, 0.5, 3, 5, 6].map((frame) => nextChange(turns, frame, 1).frame),
    [3, 3, 5, 6, 6],
  );
  assert.deepEqual(
    [6, 4.5, 3, 1, 0].map((frame) => nextChange(turns, frame, -1).frame),
    [4, 4, 0, 0, 0],
  );
  const partly = timeline([0, 1, null, 3, 4]);
  assert.deepEqual(
    [nextChange(partly, 0, 1), nextChange(partly, 2, 1), nextChange(partly, 4, -1)].map(
      ({ frame }) => frame,
    ),
    [2, 3, 2],
  );
});

test("a search for a change continues at a frame that was missing", () => {
  const angles = [0, 0.01, 0.02, 0.06, 0.06];
  const partly = timeline([0, 1, null, null, 4], angles);
  const stopped = nextChange(partly, 0, 1);
  assert.equal(stopped.frame, 2);
  assert.deepEqual(nextChange(partly, 2, 1, stopped.from), stopped);
  const complete = timeline([0, 1, 2, 3, 4], angles);
  assert.deepEqual(nextChange(complete, 2, 1, stopped.from), { frame: 3, from: null });
  assert.deepEqual(nextChange(complete, 3, 1), { frame: 4, from: null });
});

test("the search for a change also looks at hinges outside of windows", async () => {
  const { timeline: peeled } = await recorded(vectors.peeled);
  assert.ok(peeled.windowed);
  const angles = (frame) => {
    const row = peeled.row(frame);
    return Array.from({ length: peeled.joints }, (_, j) => angleIn(row, j));
  };
  for (const frame of [0, Math.round(peeled.last / 3), peeled.last]) {
    const from = angles(frame);
    const turned = (k) =>
      peeled.row(k).phase !== peeled.row(frame).phase ||
      angles(k).some((angle, j) => Math.abs(angle - from[j]) > 0.05);
    for (const way of [1, -1]) {
      let k = frame;
      do k += way;
      while (k > 0 && k < peeled.last && !turned(k));
      assert.equal(nextChange(peeled, frame, way).frame, Math.min(Math.max(k, 0), peeled.last));
    }
  }
});

test("each key has one name, also with Caps Lock", () => {
  const pressed = [
    ["n", false],
    ["N", true],
    ["?", true],
    ["ArrowLeft", false],
    ["ArrowLeft", true],
    [" ", true],
  ];
  assert.deepEqual(
    pressed.map(([key, shiftKey]) => nameOf({ key, shiftKey })),
    ["n", "n", "?", "ArrowLeft", "Shift+ArrowLeft", " "],
  );
});
