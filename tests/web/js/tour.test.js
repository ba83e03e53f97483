import assert from "node:assert/strict";
import { test } from "node:test";
import { hashOf, viewIn } from "../../../web/static/js/player/address.js";
import { Flight } from "../../../web/static/js/tour/flight.js";
import { idleSeconds } from "../../../web/static/js/tour/kiosk.js";
import {
  MAX_CAPTION,
  MAX_STOPS,
  TourState,
  frameBetween,
  movingSeconds,
  readingSeconds,
} from "../../../web/static/js/tour/state.js";

const tour = (...captions) => ({
  format: "foldback-tour/1",
  title: "Wrench",
  stops: captions.map((caption, k) => ({ caption, frame: k + 1 })),
});
const captions = ({ stops }) => stops.map(({ caption }) => caption).join("");

test("a tour is edited, and every step can be undone", () => {
  const state = new TourState(tour("a", "b", "c"));
  assert.equal(state.changed, false);
  assert.equal(state.go(9), true);
  assert.equal(state.at, 2);
  assert.equal(state.go(2), false);
  assert.equal(state.add({ caption: "d", frame: 9 }), true);
  assert.deepEqual([captions(state), state.at], ["abcd", 3]);
  assert.equal(state.move(3, -2), true);
  assert.deepEqual([captions(state), state.at], ["adbc", 1]);
  assert.equal(state.move(0, -1) || state.move(3, 1), false);
  assert.equal(state.edit(0, "  new \n words "), true);
  assert.equal(state.stops[0].caption, "new words");
  assert.equal(state.remove(3), true);
  assert.deepEqual([captions(state), state.at], ["new wordsdb", 2]);
  assert.equal(state.changed, true);
  const steps = [];
  while (state.undo()) steps.push(captions(state));
  assert.deepEqual(steps, ["new wordsdbc", "adbc", "abcd", "abc"]);
  assert.equal(state.changed, false);
});

test("an edited tour stays valid for the service", () => {
  const state = new TourState(tour("a"));
  assert.equal(state.remove(0), false);
  assert.equal(state.edit(0, " \n ") || state.edit(0, "a"), false);
  state.edit(0, "x".repeat(MAX_CAPTION + 9));
  assert.equal(state.stop.caption.length, MAX_CAPTION);
  for (let k = 1; k < MAX_STOPS; k++) assert.equal(state.add({ caption: "b", frame: 1 }), true);
  assert.equal(state.add({ caption: "b", frame: 1 }), false);
  state.keep();
  assert.equal(state.changed, false);
  state.replace(tour("draft"));
  assert.deepEqual([captions(state), state.at, state.changed], ["draft", 0, true]);
});

test("motion between stops is slow at both ends, and captions can be read", () => {
  assert.deepEqual(
    [-1, 0, 0.5, 1, 2].map((share) => frameBetween(10, 30, share)),
    [10, 10, 20, 30, 30],
  );
  assert.ok(frameBetween(10, 30, 0.1) < 12 && frameBetween(10, 30, 0.9) > 28);
  assert.ok(movingSeconds(2) >= 1 && movingSeconds(-1e6) === movingSeconds(1e6));
  assert.ok(readingSeconds("x".repeat(160)) > 8);
});

test("a visitor who moves the playhead stops the tour", () => {
  const frames = [];
  globalThis.requestAnimationFrame = (draw) => frames.push(draw);
  const player = {
    is: { playing: false },
    playhead: { frame: 0 },
    mark() {},
    send({ do: action, frame }) {
      if (action === "seek") this.playhead.frame = frame;
    },
  };
  const called = [];
  const flight = new Flight(player, {
    calm: false,
    page: { colour() {}, path() {} },
    over: () => called.push("over"),
    interrupted: () => called.push("interrupted"),
  });
  flight.show({ caption: "a", frame: 100 }, { playing: true });
  frames.pop()();
  assert.deepEqual(called, []);
  player.playhead.frame = 50;
  frames.pop()();
  assert.deepEqual([called, frames.length], [["interrupted"], 0]);
});

test("the address names a stop of the tour", () => {
  assert.equal(viewIn("#stop=3").stop, 2);
  assert.equal(viewIn("#tour=1").stop, 0);
  assert.equal(viewIn("#frame=3").stop, null);
  assert.equal(hashOf({ ...viewIn("#frame=7&stop=3") }), "#frame=7&stop=3");
});

test("the kiosk accepts seconds in its range, and uses sixty otherwise", () => {
  assert.equal(idleSeconds("?theme=dark"), null);
  assert.deepEqual(
    ["10", "3600", "9", "3601", "-30", "1e3", "99999", ""].map((seconds) =>
      idleSeconds(`?kiosk=${seconds}`),
    ),
    [10, 3600, 60, 60, 60, 60, 60, 60],
  );
});
