import assert from "node:assert/strict";
import { test } from "node:test";
import { Film } from "../../../web/static/js/player/timeline.js";
import { close, closeTurns, recorded, turnOfEvents, unpack, vectors } from "./vectors.js";

const TOTAL = 400;

// A source of `TOTAL` frames, one a second; after so many requests each it is another timeline.
function begunAnew(swaps, status) {
  const chain = { modules: 2, root: 0, rigid_links: 0, hinges: 1, axes: [[0, 0, 1]], anchor: [0.5, 0, 0], offset: [0.5, 0, 0], turn: [1, 0, 0, 0] };
  const arrays = { folded_rad: new Float32Array(1), folded_positions: new Float32Array(6) };
  return {
    asked: 0,
    scenery: async () => ({ header: { chain }, arrays }),
    async reel({ from = 0, to = null, stride = 1 }) {
      this.asked++;
      const id = `timeline ${swaps.filter((at) => this.asked > at).length}`;
      const stop = Math.min(TOTAL, to ?? TOTAL);
      const rows = Math.ceil((stop - from) / stride);
      const column = (width) => new Float32Array(rows * width);
      return {
        header: { id, status, total: TOTAL, start: from, stop, stride, outline: {} },
        arrays: {
          time_s: column(1).map((_, k) => from + k * stride),
          phase: column(1), root_position: column(3), root_wxyz: column(4), joint_angles_rad: column(1), joint_error_rad: column(1),
        },
      };
    },
  };
}

// Lets so many milliseconds pass, on a clock that goes on only when it is told to.
async function pass(timers, ms) {
  for (let k = 0; k < ms; k += 20) {
    timers.tick(20);
    await turnOfEvents();
  }
}

for (const swaps of [[], [2], [4], [4, 9]]) {
  test(`a timeline begun anew after ${swaps.join(" and ") || "no"} requests is shown to its end`, async ({ mock: { timers } }) => {
    timers.enable({ apis: ["setTimeout"] });
    const source = begunAnew(swaps, "complete");
    const film = new Film(source, { over: false });
    await pass(timers, 2500);
    film.finish();
    await pass(timers, 300);
    film.stop();
    assert.deepEqual([film.id, film.complete, film.total], [`timeline ${swaps.length}`, true, TOTAL]);
    assert.ok(source.asked < 60, `${source.asked} requests`); // it waits between looking and looking again
  });
}

test("a fold that ended in the middle is over", async () => {
  const source = begunAnew([], "growing");
  const film = new Film(source, { over: true });
  while (!film.complete) await turnOfEvents();
  film.stop();
  assert.deepEqual([film.growing, film.total], [false, TOTAL]);
  assert.ok(source.asked < 20, `${source.asked} requests`);
});

test("every frame is kept in its place, those first that are spread over the film", async () => {
  const film = new Film(begunAnew([], "complete"));
  const times = () => Array.from({ length: TOTAL }, (_, k) => film.row(k)?.time_s ?? null);
  let spread = null;
  film.on("begun", () => { spread = times(); });
  while (!film.complete) await turnOfEvents();
  const frames = Array.from({ length: TOTAL }, (_, k) => k);
  assert.deepEqual(spread, frames.map((k) => (k % 7 ? null : k)));
  assert.deepEqual(times(), frames);
});

test("frames are as they were recorded, and between two in between", async () => {
  const { film } = await recorded();
  assert.equal(film.last, vectors.film.frames.at(-1).frame);
  for (const { frame, time_s: time, angles, poses, errors } of vectors.film.frames) {
    const shown = film.snapshot(frame);
    assert.ok(shown.exact);
    assert.equal(shown.time_s, time);
    close(angles.map((_, j) => shown.angle(j)), angles, { atol: 6e-7 });
    const expected = (await unpack(poses)).arrays;
    close(shown.positions, expected.positions, { atol: 3e-6 });
    closeTurns(shown.wxyzs, expected.wxyzs, 1e-5);
    const told = film.moduleErrors(shown.errors);
    assert.deepEqual([...told].map(Number.isNaN), errors.map((v) => v === null));
    const known = errors.flatMap((v, i) => (v === null ? [] : [i]));
    close(known.map((i) => told[i]), known.map((i) => errors[i]), { rtol: 1 / 256 });
  }
  const [before, between, after] = [120, 120.25, 121].map((frame) => film.snapshot(frame));
  assert.ok(Math.abs(between.time_s - (0.75 * before.time_s + 0.25 * after.time_s)) < 1e-9);
  assert.ok(Math.abs(between.angle(0) - (0.75 * before.angle(0) + 0.25 * after.angle(0))) < 1e-9);
});

test("hinges turn as fast as their angles change", async () => {
  const { film } = await recorded();
  const [one, two] = [film.snapshot(120), film.snapshot(121)];
  const expected = Array.from({ length: film.joints }, (_, j) => (two.angle(j) - one.angle(j)) / (two.time_s - one.time_s));
  assert.ok(Math.max(...expected.map(Math.abs)) > 0.1);
  for (const frame of [120, 120.5]) close(film.speeds(frame), expected, { atol: 1e-5 });
  const seam = film.outline.phases[1].from - 1; // an explosion's last frame and a playback's first
  assert.ok(film.speeds(seam).every(Number.isNaN));
  const row = film.row(120);
  film.row = () => row; // no time passes
  assert.ok(film.speeds(120).every(Number.isNaN));
});

test("what has been fetched is scrubbed without a word to the server", async () => {
  const { film, source } = await recorded();
  const { asked } = source;
  for (const frame of [3, 90, 41, 150, 7, film.last]) assert.ok(film.snapshot(frame).exact);
  await turnOfEvents();
  assert.equal(source.asked, asked);
});
