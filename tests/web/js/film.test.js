// Films that the browser makes: their frames, their format, and the lines of their texts.
import assert from "node:assert/strict";
import { test } from "node:test";
import { ENCODINGS, bitrateOf, configOf, offered } from "../../../web/static/js/film/formats.js";
import { linesOf } from "../../../web/static/js/film/labels.js";
import { FPS, paceOf, readingSeconds, schedule } from "../../../web/static/js/film/schedule.js";

const stop = (frame, caption) => ({ frame, caption });
const letters = (text) => text.length;
const even = (first, last) => ({ frames: [first, last], shares: [0, 1] });

// Timeline of a chain with two hinges of these angles at each frame; some frames are not loaded.
const timelineOf = (angles, isLoaded = () => true) => ({
  nearest: (frame) =>
    [...angles.keys()]
      .filter(isLoaded)
      .reduce((a, b) => (Math.abs(b - frame) < Math.abs(a - frame) ? b : a)),
  row: (frame) => ({ first: 0, last: 2, angles: angles[frame] }),
});

test("a film rests at both ends and moves evenly in between", () => {
  const { frames, stops } = schedule({ pace: even(100, 400), seconds: 10 });
  assert.equal(frames.length, 10 * FPS);
  assert.equal(frames[0], 100);
  assert.equal(frames[Math.round(0.4 * FPS)], 100);
  assert.equal(frames.at(-1), 400);
  assert.ok(frames[8 * FPS] === 400 && frames[8 * FPS - 3] < 400);
  const steps = Array.from(frames.subarray(20, 200), (frame, k) => frames[21 + k] - frame);
  assert.ok(Math.max(...steps) - Math.min(...steps) < 1e-9 && steps[0] > 1);
  assert.ok(stops.every((shown) => shown === null));
});

test("a film gives its time to the frames in which most hinges turn", () => {
  // Of 100 frames, one hinge turns by 0.1 rad in the first 90; both turn by 1 rad in the last 10.
  const angles = Array.from({ length: 101 }, (_, k) =>
    k < 90 ? [k / 900, 0] : [0.1 + (k - 90) / 10, (k - 90) / 10],
  );
  for (const isLoaded of [() => true, (frame) => frame % 10 === 0]) {
    const { frames } = schedule({ pace: paceOf(timelineOf(angles, isLoaded), 0, 100), seconds: 5 });
    const share = (isCounted) => frames.filter(isCounted).length / frames.length;
    assert.ok(share((frame) => frame < 45) < 0.2);
    assert.ok(share((frame) => frame > 90 && frame < 100) > 0.5);
    assert.ok(share((frame) => frame === 100) > 0.2); // at least 1 s
    assert.ok(frames.every((frame, k) => k === 0 || frame >= frames[k - 1]));
  }
});

test("a film of hinges that do not turn moves evenly, also from one frame to the same", () => {
  const timeline = timelineOf(Array.from({ length: 11 }, () => [1, 1]));
  const { frames, shares } = paceOf(timeline, 0, 10);
  assert.deepEqual([frames[5], shares[5]], [5, 0.5]);
  assert.ok(schedule({ pace: paceOf(timeline, 7, 7), seconds: 5 }).frames.every((f) => f === 7));
});

test("a film waits at each stop of its part until the caption is read", () => {
  const text = "x".repeat(34);
  const stops = [stop(301, text), stop(201, text), stop(51, text)];
  const film = schedule({ pace: even(100, 400), seconds: 20, stops });
  assert.deepEqual([...new Set(film.stops.map((shown) => shown?.frame))], [undefined, 201, 301]);
  for (const frame of [200, 300]) {
    const count = film.frames.filter((value) => Math.abs(value - frame) < 1e-9).length;
    assert.ok(Math.abs(count / FPS - readingSeconds(text)) < 0.1, String(count));
  }
  assert.equal(film.frames.at(-1), 400);
  const moved = film.frames.every((frame, k) => k === 0 || frame >= film.frames[k - 1]);
  assert.ok(moved);
});

test("long captions leave time for the motion, and a film without motion ends", () => {
  const stops = [stop(1, "x".repeat(300)), stop(11, "x".repeat(300))];
  const { frames } = schedule({ pace: even(0, 10), seconds: 5, stops });
  const moving = frames.filter((frame) => frame > 0 && frame < 10).length;
  assert.ok(moving > FPS / 2, String(moving));
  const still = schedule({ pace: even(7, 7), seconds: 5 }).frames;
  assert.ok(still.length === 5 * FPS && still.every((frame) => frame === 7));
});

test("the best encoding of each container is offered, MP4 with H.264 first", () => {
  const named = (...codecs) => ENCODINGS.filter(({ codec }) => codecs.includes(codec));
  const codecs = (...supported) => offered(named(...supported)).map(({ codec }) => codec);
  assert.deepEqual(codecs("vp8", "avc1.4d0028", "vp09.00.40.08"), ["avc1.4d0028", "vp09.00.40.08"]);
  assert.deepEqual(codecs("vp8"), ["vp8"]);
  assert.deepEqual(codecs(), []);
  const size = { width: 1080, height: 1920 };
  const { width, bitrate, avc } = configOf(ENCODINGS[0], size, FPS);
  assert.deepEqual([width, bitrate, avc], [1080, bitrateOf(size, FPS), { format: "avc" }]);
  assert.equal(configOf(named("vp8")[0], size, FPS).avc, undefined);
});

test("texts are broken into lines that fit, and cut off with an ellipsis", () => {
  const room = { width: 10, lines: 2 };
  assert.deepEqual(linesOf("one two three", letters, room), ["one two", "three"]);
  assert.deepEqual(linesOf("  ", letters, room), []);
  const long = linesOf("one two three four five six", letters, room);
  assert.deepEqual(long, ["one two", "three fou…"]);
  const word = linesOf("Donaudampfschifffahrt", letters, room);
  assert.ok(word.length === 1 && word[0].endsWith("…") && word[0].length <= 10, word[0]);
});
