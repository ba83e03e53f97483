import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";
import { distanceNeeded } from "../../../web/static/js/viewer/camera.js";
import { clearestSight } from "../../../web/static/js/viewer/viewpoint.js";
import { Rows } from "../../../web/static/js/player/frames.js";
import { Pair } from "../../../web/static/js/player/paired_playback.js";
import { Player } from "../../../web/static/js/player/player.js";
import { PlayerState } from "../../../web/static/js/player/player_state.js";
import { Playhead } from "../../../web/static/js/player/playhead.js";
import { close, recorded, turnOfEvents, vectors } from "./vectors.js";

const PICTURE_MS = 1000 / 30;
const AT_END = vectors.timeline.frames.at(-1);
let due = [];
let now = 0;

beforeEach(() => {
  due = [];
  now = 0;
  globalThis.requestAnimationFrame = (then) => due.push(then);
});

// Draw a number of pictures.
function draw(pictures) {
  for (let k = 0; k < pictures; k++) {
    now += PICTURE_MS;
    for (const then of due.splice(0)) then(now);
  }
}

async function playerOf(options = {}, recording = vectors.timeline) {
  const { timeline } = await recorded(recording);
  const player = new Player(timeline, options);
  const events = {};
  for (const name of ["state", "module", "outline", "drawn"])
    player.on(name, (detail) => {
      events[name] = detail;
    });
  assert.equal(player.send({ do: "play" }), false); // no frames yet
  await turnOfEvents();
  draw(1);
  return { timeline, player, events };
}

test("a requested frame is shown and reported", async () => {
  const { player, events, timeline } = await playerOf();
  assert.deepEqual([events.outline.frames, events.outline.modules], [timeline.total, 16]);
  for (const { frame, time_s: time } of vectors.timeline.frames) {
    assert.ok(player.send({ do: "seek", frame }));
    draw(1);
    assert.equal(events.drawn, frame);
    assert.deepEqual(
      [events.state.frame, events.state.frames, events.state.time_s],
      [frame, timeline.total, time],
    );
  }
  assert.equal(events.state.phase, "playback");
  assert.ok(player.send({ do: "seek", percent: 0 }));
  assert.deepEqual(
    [events.state.frame, events.state.phase, events.state.error_rad],
    [0, "explosion", null],
  );
  assert.equal(player.send({ do: "dance" }), false);
});

test("the end of the story is reported", async () => {
  const { player, timeline } = await playerOf();
  const telling = [];
  player.on("state", () => telling.push(player.story.telling));
  player.story.play("finale", timeline.last - 1);
  player.show();
  draw(60);
  assert.deepEqual([telling[0], telling.at(-1)], [true, false]);
});

test("playing pauses between two pictures, but turning the view does not wait", async () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  try {
    const { player } = await playerOf({ pauseMs: () => 1e6 });
    const turn = () => {
      player.send({ do: "orbit", turn: [0.1, 0] });
      draw(1);
    };
    player.send({ do: "play" });
    turn();
    const { frame } = player.snapshot;
    draw(5);
    assert.equal(player.snapshot.frame, frame);
    turn();
    assert.ok(player.snapshot.frame > frame);
    const { frame: later } = player.snapshot;
    draw(5);
    assert.equal(player.snapshot.frame, later);
    mock.timers.tick(1e6);
    draw(1);
    assert.ok(player.snapshot.frame > later);
  } finally {
    mock.timers.reset();
  }
});

test("requests made while a timeline is fetched again are carried out when it is there", async () => {
  const { player, events, timeline } = await playerOf();
  timeline.status = "growing";
  timeline.over = false;
  const fetched = [timeline.chain, timeline.store];
  const anew = () => {
    [timeline.chain, timeline.store] = fetched;
    timeline.tell("begun");
    draw(1);
  };
  player.send({ do: "set", live: true });
  player.send({ do: "seek", frame: 3 });
  draw(1);
  anew();
  assert.deepEqual([events.state.frame, events.state.live], [3, false]); // the visitor's frame
  timeline.chain = null;
  timeline.tell("waiting");
  assert.ok(player.send({ do: "seek", percent: 100 }));
  anew();
  assert.deepEqual([events.state.frame, events.state.live], [timeline.last, false]);
  player.send({ do: "seek", frame: 3 });
  player.send({ do: "set", live: true });
  anew();
  assert.ok(events.state.live);
});

test("a batch with fewer frames than announced is used as far as it goes", () => {
  const column = (width) => new Float32Array(2 * width);
  const arrays = {
    time_s: column(1),
    phase: column(1),
    root_position: column(3),
    root_wxyz: column(4),
    joint_angles_rad: column(1),
    joint_error_rad: column(1),
  };
  assert.equal(new Rows({ arrays }, column(1).subarray(1)).rows, 2);
});

test("with reduced motion the camera jumps to a requested frame, and moves smoothly while playing", async () => {
  for (const calm of [false, true]) {
    const { player, timeline } = await playerOf({ calm });
    draw(60);
    const { distance } = player.rig.view;
    player.send({ do: "seek", frame: Math.round(timeline.last / 2) });
    draw(1);
    const goal = player.rig.goal;
    assert.notEqual(goal.distance, distance);
    assert.equal(player.rig.view === goal, calm);
    player.send({ do: "seek", frame: 0 });
    player.send({ do: "play" });
    draw(2);
    assert.notEqual(player.rig.view, player.rig.goal);
  }
});

for (const kind of ["timeline", "peeled"]) {
  test(`modules are as red as Python says: ${kind}`, async () => {
    const { player, events } = await playerOf({ usual: "error" }, vectors[kind]);
    for (const { frame, colours, errors } of vectors[kind].frames) {
      player.send({ do: "seek", frame });
      close(player.colours(), colours, { atol: 2 }); // errors travel with a precision of 1 in 256
      const finite = errors.filter((error) => error !== null);
      assert.equal(events.state.error_rad === null, !finite.length);
      if (finite.length) close([events.state.error_rad], [Math.max(...finite)], { rtol: 1 / 256 });
    }
  });
}

test("selected modules are blue, and marked ones stand out", async () => {
  const { player, timeline } = await playerOf({ usual: "error" });
  player.send({ do: "seek", frame: AT_END.frame });
  const { selected: blue, stuck } = timeline.bundle.header.colours;
  player.send({ do: "select", module: 5 });
  player.mark([2, 99]);
  const colours = player.colours();
  assert.deepEqual([...colours.subarray(15, 18)], blue);
  assert.deepEqual([...colours.subarray(6, 9)], stuck);
  close(colours.subarray(21), AT_END.colours.slice(21), { atol: 2 });
});

test("a selected module shows its cell and its joint", async () => {
  const { player, events, timeline } = await playerOf();
  player.send({ do: "seek", frame: AT_END.frame });
  player.send({ do: "select", module: 6 });
  const { index, cell, joints } = events.module;
  assert.deepEqual([index, cell.map((c) => c + 0)], [6, vectors.timeline.cells[6]]);
  const first = (6 - timeline.chain.rigid_links) * timeline.chain.hinges;
  assert.deepEqual(
    joints.map(({ name }) => name),
    vectors.timeline.joints.slice(first, first + timeline.chain.hinges),
  );
  close(
    joints.map(({ angle_rad: angle }) => angle),
    AT_END.angles.slice(first, first + timeline.chain.hinges),
  );
  close([Math.max(...joints.map(({ error_rad: error }) => error))], [AT_END.errors[6]], {
    rtol: 1 / 256,
  });
  player.send({ do: "select", module: 99 });
  assert.equal(events.module.index, 6);
  player.send({ do: "select", module: null });
  assert.equal(events.module.index, null);
});

test("joints of a peeled chain show their error where they were simulated", async () => {
  const { player, events } = await playerOf({}, vectors.peeled);
  const [explosion, middle] = vectors.peeled.frames;
  const module = middle.errors.indexOf(Math.max(...middle.errors));
  player.send({ do: "select", module });
  player.send({ do: "seek", frame: middle.frame });
  close(
    [Math.max(...events.module.joints.map(({ error_rad: error }) => error))],
    [middle.errors[module]],
    { rtol: 1 / 256 },
  );
  player.send({ do: "seek", frame: explosion.frame });
  assert.ok(events.module.joints.every(({ error_rad: error }) => error === null));
});

test("each module but the first and the last shows the hinges of its joint", () => {
  const chain = { modules: 5, rigid_links: 1, hinges: 2, hinge_names: ["z", "y"] };
  const timeline = {
    chain,
    joints: 6,
    bundle: { arrays: { folded_positions: new Float32Array(15) } },
    foldedRad: [10, 11, 12, 13, 14, 15],
  };
  const snapshot = { angle: (j) => j, errors: new Float32Array(6) };
  const hinges = [0, 1, 3, 4].map((selected) => {
    const state = Object.assign(new PlayerState(timeline, true), { snapshot, selected });
    return state.module.joints.map(({ name, angle_rad: angle, target_rad: target }) => [
      name,
      angle,
      target,
    ]);
  });
  assert.deepEqual(hinges, [
    [],
    [
      ["joint_1_z", 0, 10],
      ["joint_1_y", 1, 11],
    ],
    [
      ["joint_3_z", 4, 14],
      ["joint_3_y", 5, 15],
    ],
    [],
  ]);
});

test("a click on a module selects it, and another one deselects it", async () => {
  const { player, events } = await playerOf();
  const at = Array.from(player.snapshot.positions.subarray(9, 12));
  player.pick([at[0], at[1], at[2] + 5], [0, 0, -1]);
  assert.equal(events.module.index, 3);
  player.pick([at[0], at[1], at[2] + 5], [0, 0, -1]);
  assert.equal(events.module.index, null);
});

test("the motion plays to the end with the whole chain in view", async () => {
  const { player, events, timeline } = await playerOf({ aspect: () => 0.7 });
  player.send({ do: "play" });
  for (let k = 0; k < 900 && player.is.playing; k++) {
    draw(1);
    const { position, target } = player.rig.eye;
    assert.ok(position.every(Number.isFinite) && target.every(Number.isFinite));
    const { view } = player.rig;
    assert.ok(
      view.distance >=
        (1 - 1e-9) * distanceNeeded(player.rig.points(player.snapshot), view, player.rig.seeing()),
    );
  }
  assert.deepEqual(
    [player.is.playing, player.playhead.frame, events.state.playing],
    [false, timeline.last, false],
  );
  draw(200);
  assert.equal(due.length, 0); // nothing is drawn at rest
  player.send({ do: "play" });
  assert.equal(player.playhead.frame, 0); // from the end it restarts
});

test("the camera goes to modules that are to be looked at, and back", async () => {
  const { player } = await playerOf();
  player.send({ do: "seek", frame: 120 });
  draw(200);
  const before = player.rig.view;
  player.lookAt([3, 4], clearestSight);
  draw(200);
  const near = player.rig.view;
  const middle = [0, 1, 2].map(
    (c) =>
      ((player.snapshot.positions[9 + c] + player.snapshot.positions[12 + c]) / 2) *
      player.rig.pitch,
  );
  close(near.target, middle, { atol: 0.5 * player.rig.pitch });
  player.lookAt([]);
  draw(200);
  close(player.rig.view.target, before.target, { atol: 0.1 * player.rig.pitch });
  close([player.rig.view.distance], [before.distance], { rtol: 0.05 });
});

test("the search for the next change continues in frames that arrive later, unless another frame is requested", async () => {
  const { player, timeline } = await playerOf();
  const row = timeline.row;
  const change = (hidden) => {
    timeline.row = row;
    player.send({ do: "seek", frame: 0 });
    timeline.row = (frame) => (frame >= hidden ? null : row.call(timeline, frame));
    player.send({ do: "change", way: 1 });
    return player.playhead.frame;
  };
  const changeFrame = change(Infinity);
  const half = Math.floor(changeFrame / 2);
  assert.ok(half > 0);
  assert.equal(change(half), half);
  player.send({ do: "change", way: 1 }); // pressed again, it continues the same search
  assert.equal(player.playhead.frame, half);
  timeline.row = row;
  timeline.tell("loaded");
  assert.equal(player.playhead.frame, changeFrame);
  change(half);
  player.send({ do: "step", by: -1 });
  timeline.row = row;
  timeline.tell("loaded");
  assert.equal(player.playhead.frame, half - 1);
});

function head(last = 239, growing = false) {
  const timeline = { last, growing };
  return { timeline, playhead: new Playhead(timeline) };
}

test("a playhead stops at the end, loops, or plays backwards", () => {
  const { playhead } = head();
  playhead.do({ do: "play" });
  assert.equal(playhead.advance(1, 1), true);
  assert.equal(playhead.frame, 12); // 240 frames in 20 s
  playhead.do({ do: "set", speed: 100 });
  assert.equal(playhead.is.speed, 20);
  playhead.advance(1, 2);
  assert.deepEqual([playhead.frame, playhead.is.playing], [239, false]);
  playhead.do({ do: "set", loop: true });
  playhead.do({ do: "play" });
  playhead.advance(1, 3);
  playhead.advance(1, 3.1);
  assert.deepEqual([playhead.frame, playhead.is.playing], [239, true]); // it pauses at the end
  playhead.advance(0.01, 5);
  assert.equal(playhead.frame, 0);
  playhead.do({ do: "set", reverse: true, loop: false, speed: 1 });
  playhead.do({ do: "play" });
  playhead.advance(0.5, 6);
  assert.equal(playhead.frame, 233);
});

test("steps are whole frames, and stay in the timeline", () => {
  const { playhead } = head();
  playhead.do({ do: "seek", percent: 50 });
  assert.equal(playhead.frame, 119.5);
  const stepped = (frame, by) => {
    playhead.do({ do: "seek", frame });
    playhead.do({ do: "step", by });
    return playhead.frame;
  };
  assert.deepEqual(
    [3.5, 3, 0, 239].map((frame) => [stepped(frame, 1), stepped(frame, -1)]),
    [
      [4, 3],
      [4, 2],
      [1, 0],
      [239, 238],
    ],
  );
  assert.equal(stepped(3, -10), 0);
  assert.equal(playhead.do({ do: "nothing" }), false);
});

test("a playhead plays at its speed", () => {
  const { playhead } = head();
  playhead.do({ do: "play" });
  playhead.advance(0.05, 1);
  close([playhead.frame], [0.6]);
  playhead.do({ do: "set", speed: 5 });
  playhead.advance(0.05, 2);
  close([playhead.frame], [3.6]);
});

test("a live playhead stays at the end of a growing timeline", () => {
  const { timeline, playhead } = head(10, true);
  playhead.do({ do: "set", live: true });
  for (let k = 0; k < 60; k++) playhead.advance(0.1, k);
  assert.equal(playhead.frame, 10);
  timeline.last = 20;
  for (let k = 0; k < 60; k++) playhead.advance(0.1, k);
  assert.deepEqual([playhead.frame, playhead.is.live], [20, true]);
  timeline.growing = false;
  playhead.advance(0.1, 99);
  assert.equal(playhead.is.live, false);
});

test("two folds play their phases in step", async () => {
  const [{ player: first, timeline }, { player: second }] = [await playerOf(), await playerOf()];
  // The second has half as long an explosion.
  const playbackFrom = timeline.outline.phases[1].from;
  const { outline } = second.timeline;
  outline.phases = [
    { name: "explosion", from: playbackFrom / 2, to: playbackFrom },
    outline.phases[1],
  ];
  const pair = new Pair([first, second]);
  let latest = null;
  pair.on("state", (state) => {
    latest = state;
  });
  assert.equal(pair.send({ do: "play" }), false);
  pair.begin();
  assert.equal(pair.last, timeline.last);
  for (const [frame, secondFrame] of [
    [0, playbackFrom / 2],
    [playbackFrom - 1, playbackFrom - 1],
    [playbackFrom, playbackFrom],
    [timeline.last, timeline.last],
  ]) {
    assert.ok(pair.send({ do: "seek", frame }));
    assert.deepEqual([first.playhead.frame, second.playhead.frame], [frame, secondFrame]);
    assert.equal(latest.phase, frame < playbackFrom ? "explosion" : "playback");
  }
  close([latest.error_rad], [Math.max(...AT_END.errors)], { rtol: 1 / 256 });
  pair.send({ do: "select", module: 4 });
  assert.deepEqual([first.selected, second.selected], [4, 4]);
});

test("in real time a playhead follows the robot's clock", async () => {
  const { player, timeline, events } = await playerOf();
  const { from } = timeline.outline.phases[1];
  player.send({ do: "seek", frame: from });
  assert.ok(events.state.pace > 0 && events.state.pace !== 1);
  player.send({ do: "set", real: true });
  assert.equal(events.state.pace, 1);
  player.send({ do: "play" });
  draw(1);
  const before = player.snapshot.time_s;
  draw(3);
  close([player.snapshot.time_s - before], [(3 * PICTURE_MS) / 1000], { atol: 1e-6 });
  draw(20000);
  assert.deepEqual([player.is.playing, player.playhead.frame], [false, timeline.last]);
  player.send({ do: "set", speed: 2 });
  assert.deepEqual([player.is.real, player.is.speed], [false, 2]);
});

test("if one fold has no frames, the other one can still be played", async () => {
  const { player: playing, timeline } = await playerOf();
  const { player: none } = await playerOf();
  none.snapshot = null;
  const pair = new Pair([playing, none]);
  pair.begin();
  assert.equal(pair.send({ do: "seek", frame: 1 }), false);
  pair.leave(none);
  assert.equal(pair.last, timeline.last);
  assert.ok(pair.send({ do: "seek", frame: 1 }));
});
