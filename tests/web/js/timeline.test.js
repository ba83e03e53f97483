import assert from "node:assert/strict";
import { test } from "node:test";
import { Source, Timeline } from "../../../web/static/js/player/timeline.js";
import { close, closeTurns, recorded, turnOfEvents, unpack, vectors } from "./vectors.js";

const TOTAL = 400;

// Source of `TOTAL` frames, one per second; after each number of requests the timeline is replaced.
function begunAnew(swaps, status) {
  const chain = {
    modules: 2,
    root: 0,
    rigid_links: 0,
    hinges: 1,
    axes: [[0, 0, 1]],
    anchor: [0.5, 0, 0],
    offset: [0.5, 0, 0],
    turn: [1, 0, 0, 0],
  };
  const arrays = { folded_rad: new Float32Array(1), folded_positions: new Float32Array(6) };
  return {
    asked: 0,
    bundle: async () => ({ header: { chain }, arrays }),
    async batch({ from = 0, to = null, stride = 1 }) {
      this.asked++;
      const id = `timeline ${swaps.filter((at) => this.asked > at).length}`;
      const stop = Math.min(TOTAL, to ?? TOTAL);
      const rows = Math.ceil((stop - from) / stride);
      const column = (width) => new Float32Array(rows * width);
      return {
        header: { id, status, total: TOTAL, start: from, stop, stride, outline: {} },
        arrays: {
          time_s: column(1).map((_, k) => from + k * stride),
          phase: column(1),
          root_position: column(3),
          root_wxyz: column(4),
          joint_angles_rad: column(1),
          joint_error_rad: column(1),
        },
      };
    },
  };
}

// Advance the test's clock by some milliseconds.
async function pass(timers, ms) {
  for (let k = 0; k < ms; k += 20) {
    timers.tick(20);
    await turnOfEvents();
  }
}

for (const swaps of [[], [2], [4], [4, 9]]) {
  test(`a timeline that restarts after ${swaps.join(" and ") || "no"} requests is shown to its end`, async ({
    mock: { timers },
  }) => {
    timers.enable({ apis: ["setTimeout"] });
    const source = begunAnew(swaps, "complete");
    const timeline = new Timeline(source, { over: false });
    await pass(timers, 2500);
    timeline.finish();
    await pass(timers, 300);
    timeline.stop();
    assert.deepEqual(
      [timeline.id, timeline.complete, timeline.total],
      [`timeline ${swaps.length}`, true, TOTAL],
    );
    assert.ok(source.asked < 60, `${source.asked} requests`); // it waits between polls
  });
}

test("a fold that stopped half-way counts as over", async () => {
  const source = begunAnew([], "growing");
  const timeline = new Timeline(source, { over: true });
  while (!timeline.complete) await turnOfEvents();
  timeline.stop();
  assert.deepEqual([timeline.growing, timeline.total], [false, TOTAL]);
  assert.ok(source.asked < 20, `${source.asked} requests`);
});

test("every frame is stored in its place, first some that are spread over the timeline", async () => {
  const timeline = new Timeline(begunAnew([], "complete"));
  const times = () => Array.from({ length: TOTAL }, (_, k) => timeline.row(k)?.time_s ?? null);
  let spread = null;
  timeline.on("begun", () => {
    spread = times();
  });
  while (!timeline.complete) await turnOfEvents();
  const frames = Array.from({ length: TOTAL }, (_, k) => k);
  assert.deepEqual(
    spread,
    frames.map((k) => (k % 7 ? null : k)),
  );
  assert.deepEqual(times(), frames);
});

for (const kind of ["timeline", "peeled"]) {
  test(`frames are as recorded, and interpolated between two: ${kind}`, async () => {
    const recording = vectors[kind];
    const { timeline } = await recorded(recording);
    assert.equal(timeline.windowed, kind === "peeled");
    timeline.standing.clear(); // otherwise it rotates the poses
    assert.equal(timeline.last, recording.frames.at(-1).frame);
    for (const { frame, time_s: time, angles, poses, errors } of recording.frames) {
      const snapshot = timeline.snapshot(frame);
      assert.ok(snapshot.exact);
      assert.equal(snapshot.time_s, time);
      close(
        angles.map((_, j) => snapshot.angle(j)),
        angles,
        { atol: 6e-7 },
      );
      const expected = (await unpack(poses)).arrays;
      // Roundings add up along a rod.
      close(snapshot.positions, expected.positions, { atol: kind === "peeled" ? 3e-5 : 3e-6 });
      closeTurns(snapshot.wxyzs, expected.wxyzs, 1e-5);
      const perModule = timeline.perModule(snapshot.errors);
      assert.deepEqual(
        [...perModule].map(Number.isNaN),
        errors.map((v) => v === null),
      );
      const finite = errors.flatMap((v, i) => (v === null ? [] : [i]));
      close(
        finite.map((i) => perModule[i]),
        finite.map((i) => errors[i]),
        { atol: 1e-12, rtol: 1 / 256 },
      );
    }
    const { frame: middle, errors } = recording.frames[1];
    assert.ok(Math.max(...errors) > 0);
    const [before, between, after] = [middle, middle + 0.25, middle + 1].map((frame) =>
      timeline.snapshot(frame),
    );
    assert.ok(Math.abs(between.time_s - (0.75 * before.time_s + 0.25 * after.time_s)) < 1e-9);
    for (const j of before.errors.keys())
      assert.ok(
        Math.abs(between.angle(j) - (0.75 * before.angle(j) + 0.25 * after.angle(j))) < 1e-7,
      );
    assert.deepEqual(between.errors, before.errors);
  });
}

test("hinge speeds follow from the changes of angles", async () => {
  const { timeline } = await recorded();
  const [earlier, later] = [timeline.snapshot(120), timeline.snapshot(121)];
  const expected = Array.from(
    { length: timeline.joints },
    (_, j) => (later.angle(j) - earlier.angle(j)) / (later.time_s - earlier.time_s),
  );
  assert.ok(Math.max(...expected.map(Math.abs)) > 0.1);
  for (const frame of [120, 120.5]) close(timeline.speeds(frame), expected, { atol: 1e-5 });
  // An explosion's last frame and a playback's first.
  const seam = timeline.outline.phases[1].from - 1;
  assert.ok(timeline.speeds(seam).every(Number.isNaN));
  const row = timeline.row(120);
  timeline.row = () => row; // no time passes
  assert.ok(timeline.speeds(120).every(Number.isNaN));
});

test("fetched frames are scrubbed without requests to the server", async () => {
  const { timeline, source } = await recorded();
  const { asked: requests } = source;
  for (const frame of [3, 90, 41, 150, 7, timeline.last]) assert.ok(timeline.snapshot(frame).exact);
  await turnOfEvents();
  assert.equal(source.asked, requests);
});

test("a refused request is repeated when the service says so", async ({ mock }) => {
  const { timers } = mock;
  timers.enable({ apis: ["setTimeout"] });
  const source = begunAnew([], "growing");
  const busy = new Source("/folds/one");
  let requests = 0;
  mock.method(globalThis, "fetch", async () => {
    requests++;
    return new Response("{}", { status: 429, headers: { "Retry-After": "2" } });
  });
  const { batch } = source;
  source.batch = function wait(options) {
    return options?.wait ? busy.batch(options) : batch.call(this, options);
  };
  const timeline = new Timeline(source, { over: false });
  await pass(timers, 1900);
  assert.equal(requests, 1);
  await pass(timers, 400);
  assert.equal(requests, 2);
  timeline.stop();
  assert.ok(timeline.chain && timeline.growing); // existing data stay
});

test("the timeline of a running fold asks often for its first frames", async ({
  mock: { timers },
}) => {
  timers.enable({ apis: ["setTimeout"] });
  const source = begunAnew([], "complete");
  const { batch } = source;
  const calls = [];
  source.batch = function first(options) {
    calls.push(options);
    return calls.length < 50 ? null : batch.call(this, options);
  };
  const timeline = new Timeline(source, { over: false });
  await pass(timers, 990);
  const often = calls.length;
  await pass(timers, 2000);
  assert.ok(often >= 16 && calls.length < 50, `${often}, then ${calls.length} requests`);
  await pass(timers, 4500);
  assert.ok(timeline.row(0));
  timeline.stop(); // before the test's clock is gone
});

test("the bundle is fetched once, before the first frame", async ({ mock: { timers } }) => {
  timers.enable({ apis: ["setTimeout"] });
  const source = begunAnew([], "complete");
  const { bundle, batch } = source;
  let frames = false;
  let bundles = 0;
  source.bundle = () => {
    bundles++;
    return bundle();
  };
  source.batch = async (options) => {
    const message = await batch.call(source, options);
    if (!frames) message.header.total = 0;
    return message;
  };
  const timeline = new Timeline(source, { over: false });
  await pass(timers, 300);
  const before = bundles;
  frames = true;
  await pass(timers, 100);
  timeline.stop();
  assert.ok(timeline.chain);
  // At the first poll, and when it existed without frames.
  assert.deepEqual([before, bundles], [2, 2]);
});

test("the bundle of a timeline without frames is not used for the one that replaces it", async ({
  mock: { timers },
}) => {
  timers.enable({ apis: ["setTimeout"] });
  const source = begunAnew([], "complete");
  const { bundle, batch } = source;
  let id = "empty";
  const bundles = [];
  source.bundle = async () => {
    bundles.push(id);
    return { ...(await bundle()), of: id };
  };
  source.batch = async (range) => {
    const result = await batch.call(source, range);
    Object.assign(result.header, { id, total: id === "empty" ? 0 : TOTAL });
    return result;
  };
  const timeline = new Timeline(source, { over: false });
  await pass(timers, 300);
  id = "replacement";
  await pass(timers, 100);
  timeline.stop();
  assert.deepEqual([timeline.id, timeline.bundle.of], ["replacement", "replacement"]);
  assert.deepEqual(bundles, ["empty", "empty", "replacement"]);
});

for (const [status, requests] of [
  ["growing", 1],
  ["complete", 2],
]) {
  test(`before a ${status} timeline begins, its batches are requested ${requests} times`, async () => {
    const source = begunAnew([], status);
    const timeline = new Timeline(source, { over: false });
    let requestsAtStart = 0;
    timeline.on("begun", () => {
      requestsAtStart = source.asked;
      timeline.stop();
    });
    while (!timeline.ended) await turnOfEvents();
    // Frames spread over a timeline that grows would be outdated.
    assert.equal(requestsAtStart, requests);
  });
}
