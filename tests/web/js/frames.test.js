import assert from "node:assert/strict";
import { test } from "node:test";
import { decode } from "../../../web/static/js/lib/columns.js";
import {
  FrameStore,
  Rows,
  angleIn,
  between,
  thereAndBack,
} from "../../../web/static/js/player/frames.js";
import {
  Kinematics,
  Standing,
  foldedness,
  frameFolded,
} from "../../../web/static/js/player/kinematics.js";
import { close, closeTurns, recorded, unpack, vectors } from "./vectors.js";

for (const { name, bundle, batch, frames } of vectors.windows) {
  test(`poses of a window of ${name}`, async () => {
    const { header, arrays } = await unpack(bundle);
    const foldedRad = arrays.folded_rad;
    const kinematics = new Kinematics(header.chain, foldedRad);
    const rows = new Rows(await unpack(batch), foldedRad);
    assert.equal("errors_rad" in rows.arrays, name === "cubes"); // the others were not simulated
    let [straight, folded, off] = [0, 0, 0];
    for (const { frame, poses } of frames) {
      const low = Math.floor(frame);
      let row = rows.row(low);
      if (frame > low) row = between(row, rows.row(low + 1), frame - low);
      const { positions, wxyzs, core, rod } = kinematics.windowPoses(row);
      const expected = (await unpack(poses)).arrays;
      // Both ends have single precision, and one is far away.
      const length = expected.positions.reduce((max, v) => Math.max(max, Math.abs(v)), 1);
      close(positions, expected.positions, { atol: 1e-6 * length });
      closeTurns(wxyzs, expected.wxyzs);
      close(
        Float64Array.from(foldedRad, (_, j) => angleIn(row, j)),
        expected.angles,
      );
      assert.deepEqual([...row.errors].map(Number.isNaN), [...expected.errors].map(Number.isNaN));
      const errorPair = expected.errors.some(Number.isNaN)
        ? [[], []]
        : [row.errors, expected.errors];
      close(...errorPair, { atol: 1e-12, rtol: 1 / 256 });
      off = Math.max(off, ...errorPair[1]);
      assert.ok(core >= 1 && core <= rod + 1 && rod + 1 <= header.chain.modules);
      straight = Math.max(straight, header.chain.modules - rod);
      folded = Math.max(folded, core);
    }
    assert.ok(straight > 100);
    assert.equal(off > 1e-3, name === "cubes");
    assert.equal(folded, header.chain.modules);
  });
}

test("the windows of a plan are played backwards, then forwards", async () => {
  const { bundle, batch } = vectors.windows[0];
  const foldedRad = (await unpack(bundle)).arrays.folded_rad;
  const plan = new Rows(await unpack(batch), foldedRad);
  const { first, ends, angles: values } = plan.arrays;
  const offsets = [0, ...ends],
    none = new Float32Array();
  const last = Array.from(first, (a, k) => a + offsets[k + 1] - offsets[k]);
  const roundTrip = thereAndBack({ frames: plan.rows, first, last, offsets, values });
  const rows = new Rows(
    {
      arrays: {
        ...roundTrip,
        time_s: new Float64Array(2 * plan.rows),
        phase: [],
        base_position: none,
        base_wxyz: none,
      },
    },
    foldedRad,
  );
  for (let k = 0; k < plan.rows; k += 7) {
    for (const frame of [plan.rows + k, plan.rows - 1 - k]) {
      for (const name of ["first", "last", "angles"])
        assert.deepEqual(rows.row(frame)[name], plan.row(k)[name]);
    }
  }
});

test("packed columns are decoded", async () => {
  const { message, angles, errors } = vectors.columns;
  const { header, arrays } = await unpack(message);
  assert.deepEqual(header, { said: "ü" });
  assert.deepEqual([...arrays.plain], [0, 1, 2, 3, 4]);
  close(arrays.angles, angles, { atol: 6e-7 });
  const finite = errors.flatMap((v, k) => (v === null ? [] : [k]));
  close(
    finite.map((k) => arrays.errors[k]),
    finite.map((k) => errors[k]),
    { rtol: 1 / 256 },
  );
  assert.deepEqual(
    [...arrays.errors].map(Number.isNaN),
    errors.map((v) => v === null),
  );
});

test("a message that was cut short is refused", async () => {
  const complete = Buffer.from(vectors.columns.message, "base64");
  const half = new Uint8Array(complete.subarray(0, complete.length / 2));
  await assert.rejects(decode(half.buffer));
});

const TURN = [Math.SQRT1_2, Math.SQRT1_2, 0, 0]; // a quarter turn about x
const [FROM, TO] = [100, 201];

const angleBetween = (a, b) =>
  2 * Math.acos(Math.min(1, Math.abs(a.reduce((sum, v, k) => sum + v * b[k], 0))));
// Positions relative to the first module.
const relative = (positions) => positions.map((v, k) => v - positions[k % 3]);

for (const recording of vectors.shipped) {
  test(`the last frame of ${recording.name} is drawn as its chain says`, async () => {
    const { timeline } = await recorded(recording);
    const drawn = (await unpack(recording.drawn)).arrays;
    const snapshot = timeline.snapshot(timeline.last);
    close(relative(snapshot.positions), relative(drawn.positions), { atol: 0.05 });
    for (let i = 0; i < timeline.chain.modules; i++) {
      const off = angleBetween(
        snapshot.wxyzs.subarray(4 * i, 4 * i + 4),
        drawn.wxyzs.subarray(4 * i, 4 * i + 4),
      );
      assert.ok(off < 0.01, `module ${i} is off by ${off} rad`);
    }
    const [root, straight] = [timeline.row(0), timeline.row(timeline.outline.phases.at(-1).from)];
    for (const row of [root, straight])
      assert.equal(
        timeline.standing.turned(row.wxyz, row === root ? 0 : timeline.outline.phases.at(-1).from),
        row.wxyz,
      );
    let last = null;
    let maxTurn = 0;
    for (let frame = 0; frame <= timeline.last; frame += 0.5) {
      const turn = timeline.standing.turned([1, 0, 0, 0], frame);
      if (last) maxTurn = Math.max(maxTurn, angleBetween(turn, last));
      last = turn;
    }
    assert.ok(maxTurn < 0.05, `turns by ${maxTurn} rad in half a frame`);
  });

  test(`${recording.name} counts as 0 folded where it is straight and as 1 where it is folded`, async () => {
    const { timeline } = await recorded(recording);
    const at = (frame) => timeline.folded(timeline.snapshot(frame));
    const { from } = timeline.outline.phases.findLast(({ name }) => name === "playback");
    close(
      [at(0), at(from), at(timeline.last)],
      [timeline.outline.phases.length > 1 ? 1 : 0, 0, 1],
      { atol: 0.01 },
    );
    let maxFolded = 0;
    for (let frame = from; frame <= timeline.last; frame++) {
      assert.ok(at(frame) > maxFolded - 0.02, `frame ${frame} is folded less than one before`);
      maxFolded = Math.max(maxFolded, at(frame));
    }
    for (const share of [0.25, 0.5, 0.9])
      close([at(frameFolded(timeline, share))], [share], { atol: 0.005 });
    close([frameFolded(timeline, 0), frameFolded(timeline, 1)], [from, timeline.last], {});
  });
}

test("a tangled chain does not count as folded", () => {
  const goal = Float64Array.from([1, -1, 0, 1]);
  close([foldedness((j) => [1, -1, 0, 0][j], goal)], [2 / 3]);
  // Beyond is folded, the other sign is 0.
  close([foldedness((j) => [3, 1, 1, 0.5][j], goal)], [1.5 / 3]);
  assert.equal(
    foldedness((j) => -goal[j], goal),
    0,
  );
  assert.equal(
    foldedness((j) => goal[j], goal),
    1,
  );
});

test("the first folded frame is found among the frames that have been fetched", () => {
  const fetched = new Set([0, 40, 100]);
  const timeline = {
    outline: { phases: [{ name: "playback", from: 0, to: 101 }] },
    foldedRad: Float64Array.from([1, 2]),
    row: (frame) =>
      fetched.has(frame) ? { first: 0, last: 2, angles: [frame / 100, frame / 50] } : null,
    nearest: (frame) => [...fetched].sort((a, b) => Math.abs(a - frame) - Math.abs(b - frame))[0],
  };
  close([frameFolded(timeline, 0.7), frameFolded(timeline, 0.1)], [70, 10], { atol: 1e-9 });
  timeline.outline.phases[0].name = "explosion";
  assert.equal(frameFolded(timeline, 0.5), null);
});

test("the table of an open page fades in", () => {
  const standing = new Standing();
  const end = [1, 0, 0, 0];
  standing.set(end, TURN, { name: "playback", from: FROM, to: TO }, true);
  assert.equal(standing.turned(end, TO - 1), end);
  let pictures = 0;
  while (standing.advance(1 / 30)) pictures++;
  assert.ok(pictures > 10);
  close(standing.turned(end, TO - 1), TURN);
  close(standing.turned(end, (FROM + TO - 1) / 2), [
    Math.cos(Math.PI / 8),
    Math.sin(Math.PI / 8),
    0,
    0,
  ]);
  standing.set(TURN, TURN, { name: "playback", from: FROM, to: TO }, false);
  assert.equal(standing.turned(end, TO - 1), end); // it is already upright
});

// Rows of frames, each with its own number.
const batch = (rows, name, bytes = 100) => ({ rows, bytes, row: (k) => `${name} ${k}` });

function filled(total, { joints = 3000, windowed = false } = {}) {
  const store = new FrameStore(joints, windowed);
  store.total = total;
  return store;
}

test("each frame is read from the latest batch that holds it, and a missing one from its nearest neighbour", () => {
  const store = filled(400);
  store.put(batch(3, "spread"), { start: 100, stride: 100 });
  store.put(batch(10, "part"), { start: 195, stride: 1 });
  assert.deepEqual(
    [100, 195, 200, 204].map((frame) => store.row(frame)),
    ["spread 0", "part 0", "part 5", "part 9"],
  );
  assert.deepEqual(
    [0, 99, 205].map((frame) => store.row(frame)),
    [null, null, null],
  );
  assert.deepEqual(
    [0, 199, 212, 399].map((frame) => store.nearest(frame)),
    [100, 199, 204, 300],
  );
  assert.equal(new FrameStore().nearest(0), null);
});

test("frames are fetched from the current one on, around the timeline, until all are there", () => {
  const store = filled(400);
  const { rows, count } = store;
  assert.ok(rows > 10 && count > 4);
  store.focus = 2 * rows + 1;
  const order = [];
  for (let next = store.next(false); next !== null; next = store.next(false)) {
    order.push(next);
    store.loading.add(next);
  }
  assert.deepEqual(
    order,
    Array.from({ length: count }, (_, k) => (k + 2) % count),
  );
  store.loading.clear();
  store.put(batch(5, "begin"), { start: 0, stride: 1 });
  assert.deepEqual(store.missing(0), { from: 5, to: rows });
  assert.deepEqual(store.missing(count - 1), { from: (count - 1) * rows, to: 400 });
  store.put(batch(400, "all"), { start: 0, stride: 1 });
  assert.equal(store.next(true), null);
});

test("of a long timeline only frames near the current one are fetched, and the last one if it is needed", () => {
  const store = filled(100 * 256, { windowed: true });
  store.focus = 50 * 256;
  const chunksNear = (end) => [...store.near(end)];
  assert.deepEqual(chunksNear(false), [50, 51, 49, 52, 53, 54, 55, 56]);
  assert.equal(chunksNear(true).at(-1), 99);
  store.focus = 0;
  assert.deepEqual(chunksNear(false), [0, 1, 2, 3, 4, 5, 6]);
});

test("when memory is full, the frames farthest from the current one are dropped", () => {
  const store = filled(20 * 256, { windowed: true });
  store.focus = 10 * 256;
  for (let k = 0; k < 20; k++) store.put(batch(256, k, 8 * 2 ** 20), { start: 256 * k, stride: 1 });
  store.spare();
  assert.equal(store.bytes, 64 * 2 ** 20);
  const chunks = new Set([...store.frames.keys()].map((frame) => Math.floor(frame / 256)));
  assert.deepEqual(
    [...chunks].map((k) => Math.abs(k - 10) <= 4),
    Array(8).fill(true),
  );
});
