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

// Return a tour's flight over a timeline whose frames are loaded only once `load` is called.
function flown({ loaded = true } = {}) {
  const frames = [];
  globalThis.requestAnimationFrame = (draw) => frames.push(draw);
  const called = [];
  const sent = [];
  const moment = (frame) => ({ frame, exact: loaded, positions: new Float64Array(9) });
  const player = {
    is: { playing: false },
    playhead: { frame: 0 },
    timeline: { peek: moment, bundle: { header: { camera: { elevation_rad: 0.4 } } } },
    rig: {
      pitch: 1,
      whole: (_, { azimuth, elevation }) => ({
        azimuth: azimuth ?? 1,
        elevation,
        distance: 9,
        target: [0, 0, 0],
      }),
    },
    get snapshot() {
      return moment(this.playhead.frame);
    },
    mark() {},
    send(command) {
      sent.push(command);
      if (command.do !== "seek") return;
      this.playhead.frame = command.frame;
      this.is.playing = false;
    },
  };
  const flight = new Flight(player, {
    calm: false,
    page: { colour() {}, path() {} },
    arrived: () => called.push("arrived"),
    over: () => called.push("over"),
    interrupted: () => called.push("interrupted"),
  });
  const load = () => (loaded = true);
  return { flight, player, frames, called, sent, load };
}

test("a visitor who moves the playhead stops the tour", () => {
  const { flight, player, frames, called } = flown();
  flight.show({ caption: "a", frame: 100 }, { playing: true });
  frames.pop()();
  assert.deepEqual(called, []);
  player.playhead.frame = 50;
  frames.pop()();
  assert.deepEqual([called, frames.length], [["interrupted"], 0]);
});

test("a stop arrives once its frame is loaded, and its part plays after a rest", ({ mock }) => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const { flight, player, frames, called, sent, load } = flown({ loaded: false });
  player.playhead.frame = 70;
  player.is.playing = true;
  flight.show({ caption: "a", frame: 1, from: 1, to: 90 }, { jump: true });
  frames.pop()();
  assert.deepEqual([called, player.playhead.frame, flight.moving], [[], 0, true]);
  load();
  frames.pop()();
  assert.deepEqual([called, flight.moving], [["arrived"], false]);
  const plays = () => sent.some((command) => command.do === "play");
  assert.equal(plays(), false);
  mock.timers.tick(10_000);
  assert.equal(plays(), true);
});

test("the whole chain is in view at a stop with modules", () => {
  const { flight, sent } = flown();
  flight.show({ caption: "a", frame: 1, modules: [1, 3] }, { jump: true });
  const { camera } = sent.find((command) => command.do === "camera");
  assert.deepEqual([camera.zoom, camera.offset], [1, null]);
  assert.ok(Number.isFinite(camera.azimuth));
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
