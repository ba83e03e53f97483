// Films that the browser makes: their frames, their format, and the lines of their texts.
import assert from "node:assert/strict";
import { test } from "node:test";
import { ENCODINGS, bitrateOf, configOf, offered } from "../../../web/static/js/film/formats.js";
import { linesOf, titleOpacity } from "../../../web/static/js/film/labels.js";
import { FPS, readingSeconds, schedule } from "../../../web/static/js/film/schedule.js";

const stop = (frame, caption) => ({ frame, caption });
const letters = (text) => text.length;

test("a film rests at both ends and moves evenly in between", () => {
  const { frames, stops } = schedule({ first: 100, last: 400, seconds: 10 });
  assert.equal(frames.length, 10 * FPS);
  assert.equal(frames[0], 100);
  assert.equal(frames[Math.round(0.4 * FPS)], 100);
  assert.equal(frames.at(-1), 400);
  assert.ok(frames[9 * FPS - 2] === 400 && frames[8 * FPS] < 400);
  const steps = Array.from(frames.subarray(20, 200), (frame, k) => frames[21 + k] - frame);
  assert.ok(Math.max(...steps) - Math.min(...steps) < 1e-9 && steps[0] > 1);
  assert.ok(stops.every((shown) => shown === null));
});

test("a film waits at each stop of its part until the caption is read", () => {
  const text = "x".repeat(34);
  const stops = [stop(301, text), stop(201, text), stop(51, text)];
  const film = schedule({ first: 100, last: 400, seconds: 20, stops });
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
  const { frames } = schedule({ first: 0, last: 10, seconds: 5, stops });
  const moving = frames.filter((frame) => frame > 0 && frame < 10).length;
  assert.ok(moving > FPS / 2, String(moving));
  const still = schedule({ first: 7, last: 7, seconds: 5 }).frames;
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

test("the title is shown in the beginning and in the end", () => {
  assert.deepEqual(
    [0, 2, 5, 9.5, 10].map((seconds) => titleOpacity(seconds, 10)),
    [1, 1, 0, 1, 1],
  );
  assert.ok(titleOpacity(2.4, 10) > 0 && titleOpacity(2.4, 10) < 1);
});
