import assert from "node:assert/strict";
import { test } from "node:test";
import { Playhead } from "../../../web/static/js/player/playhead.js";

function head(last = 239, growing = false) {
  const playhead = new Playhead({ last, growing });
  const set = (told) => { playhead.do({ do: "set", ...told }); return [playhead.is.from, playhead.is.to, playhead.is.loop]; };
  return { playhead, set };
}

test("the ends of a loop lie in the timeline, and one that would cross the other takes its place", () => {
  const { set } = head();
  assert.deepEqual(set({ from: 20 }), [20, null, true]);
  assert.deepEqual(set({ to: 60 }), [20, 60, true]);
  assert.deepEqual(set({ from: 80 }), [80, null, true]);
  assert.deepEqual(set({ to: 40 }), [null, 40, true]);
  assert.deepEqual(set({ to: 239 }), [null, null, true]); // it goes on looping, over everything
  assert.deepEqual(head().set({ from: 0, to: 99_999_999 }), [null, null, false]);
  assert.deepEqual(head().set({ from: 99_999_999, to: 5 }), [null, 5, true]);
  assert.deepEqual(head(10, true).set({ from: 50, to: 80 }), [50, 80, true]); // they may come yet
});

test("who loops over a part begins in it, and goes from its end to its beginning", () => {
  const { playhead, set } = head();
  set({ from: 100, to: 112 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 100);
  playhead.advance(0.5, 1);
  assert.equal(playhead.frame, 106); // 12 frames a second
  playhead.advance(2, 2);
  assert.deepEqual([playhead.frame, playhead.is.playing], [112, true]);
  playhead.advance(0.5, 5); // it has held there
  assert.equal(playhead.frame, 100);
  playhead.do({ do: "seek", frame: 200 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 100);
  set({ reverse: true });
  playhead.do({ do: "seek", frame: 200 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 112);
  set({ loop: false, reverse: false }); // without it all is played, and the ends are kept
  playhead.do({ do: "seek", frame: 238 });
  playhead.do({ do: "play" });
  playhead.advance(1, 9);
  assert.deepEqual([playhead.frame, playhead.is.playing, playhead.is.to], [239, false, 112]);
});

test("a part of what is not there yet is no part", () => {
  const { playhead, set } = head(10, true);
  set({ from: 50, to: 80 });
  playhead.do({ do: "play" });
  assert.equal(playhead.frame, 0);
  playhead.timeline.last = 60;
  assert.deepEqual(playhead.range, [50, 60]);
});
