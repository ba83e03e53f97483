import assert from "node:assert/strict";
import { test } from "node:test";
import { Place } from "../../../web/static/js/player/address.js";
import { Playhead } from "../../../web/static/js/player/playhead.js";
import { Story } from "../../../web/static/js/player/story.js";

const TICK_S = 1 / 30;
const EXPLOSION = 500;

// A fold of so many frames in each phase, and what its page shows while seconds pass.
function told({ explosion = EXPLOSION, playback = 0, growing = true, over = false, calm = false } = {}) {
  const timeline = { growing, over, windowed: false, outline: { phases: [] }, last: 0 };
  const playhead = new Playhead(timeline);
  const story = new Story(playhead, timeline, calm);
  playhead.story = story;
  const has = (exploded, played) => {
    timeline.outline.phases = [{ name: "explosion", from: 0, to: exploded }];
    if (played) timeline.outline.phases.push({ name: "playback", from: exploded, to: exploded + played });
    timeline.last = exploded + played - 1;
  };
  let now = 0;
  const pass = (seconds, each = () => {}) => {
    for (let k = 0; k < Math.round(seconds / TICK_S); k++) {
      now += TICK_S;
      story.advance(TICK_S);
      playhead.advance(TICK_S, now);
      each(k * TICK_S);
    }
    return playhead.frame;
  };
  const finish = () => { Object.assign(timeline, { growing: false, over: true }); story.settled(); };
  const send = (message) => { story.heard(message); playhead.do(message); };
  has(explosion, playback);
  story.begun();
  return { timeline, playhead, story, has, pass, finish, send };
}

for (const frames of [100, EXPLOSION, 4000]) {
  test(`story_begun_plays_an_explosion_of_${frames}_frames_in_four_to_six_seconds`, () => {
    const { pass, playhead } = told({ explosion: frames });
    assert.ok(pass(4) < frames - 1);
    assert.ok(pass(2.5) > frames - 2, `frame ${playhead.frame}`);
    assert.ok(playhead.is.playing);
  });
}

test("story_explosion_that_comes_at_once_moves_without_jumps", () => {
  const { has, pass, playhead } = told({ explosion: 5 });
  let before = playhead.frame;
  let most = 0;
  let moved = false;
  const look = () => {
    most = Math.max(most, playhead.frame - before);
    moved ||= playhead.frame > 0.5;
    before = playhead.frame;
  };
  pass(0.5, look);
  assert.ok(moved); // with five frames it is in motion
  has(EXPLOSION, 0);
  pass(2, look);
  has(EXPLOSION, 80);
  pass(6, look);
  assert.ok(most <= (1.2 * EXPLOSION * TICK_S) / 5, `${most} frames in one picture`);
});

test("story_ahead_of_the_computation_waits_at_the_newest_frame_and_goes_on", () => {
  const { has, pass, playhead } = told({ explosion: 40 });
  pass(9);
  assert.ok(playhead.frame > 38.9 && playhead.frame <= 39);
  const there = playhead.frame;
  pass(1);
  assert.equal(playhead.frame, there); // nothing is drawn while it waits
  has(80, 0);
  assert.ok(pass(1) > 45);
});

test("story_verdict_after_the_end_plays_the_fold_from_straight_once_and_rests", () => {
  const { timeline, playhead, story, pass, finish } = told({ playback: 200 });
  pass(20);
  timeline.growing = false;
  pass(1);
  finish();
  assert.deepEqual([playhead.frame, playhead.is.playing], [EXPLOSION, true]);
  assert.ok(pass(3) < timeline.last - 50);
  pass(9);
  assert.deepEqual([playhead.frame, playhead.is.playing, story.telling], [timeline.last, false, false]);
  pass(5);
  assert.equal(playhead.frame, timeline.last);
});

test("story_verdict_during_the_explosion_plays_on_to_the_finished_shape", () => {
  const { timeline, playhead, pass, finish } = told({ playback: 200 });
  const there = pass(2);
  finish();
  assert.equal(playhead.frame, there);
  assert.ok(pass(1) > there);
  pass(15);
  assert.deepEqual([playhead.frame, playhead.is.playing], [timeline.last, false]);
});

for (const message of [{ do: "seek", frame: 40 }, { do: "step", by: 1 }, { do: "pause" }, { do: "set", live: true }]) {
  test(`story_visitor_who_sends_${message.do}_is_not_interrupted`, () => {
    const { playhead, story, pass, send, finish } = told({ playback: 200 });
    pass(2);
    send(message);
    const { frame, is: { playing } } = playhead;
    finish();
    assert.deepEqual([playhead.frame, playhead.is.playing, story.framesPerSecond], [frame, playing, null]);
  });
}

test("story_address_without_a_view_goes_on", () => {
  const { story, send } = told();
  send({ do: "select", module: null });
  send({ do: "set", from: null, to: null, loop: false, speed: 1, follow: true });
  assert.ok(story.telling);
  send({ do: "set", from: null, to: 9 });
  assert.ok(!story.telling);
});

test("story_visitor_who_turned_the_view_sees_no_jump_back_at_the_verdict", () => {
  const { timeline, playhead, story, pass, finish } = told({ playback: 200 });
  story.heard({ do: "orbit", turn: [1, 0] });
  pass(30);
  finish();
  pass(1);
  assert.deepEqual([playhead.frame, playhead.is.playing], [timeline.last, false]);
});

test("story_timeline_begun_anew_starts_over_but_not_for_a_visitor_who_went_elsewhere", () => {
  const { playhead, story, pass, send } = told();
  pass(3);
  story.begun();
  assert.deepEqual([playhead.frame, playhead.is.playing], [0, true]);
  assert.ok(pass(2) > 50);
  send({ do: "seek", frame: 7 });
  story.begun();
  assert.deepEqual([playhead.frame, playhead.is.playing], [7, false]);
});

test("story_calm_shows_the_first_frame_and_the_finished_shape_at_the_verdict", () => {
  const { timeline, playhead, pass, finish } = told({ playback: 200, calm: true });
  assert.deepEqual([pass(5), playhead.is.playing], [0, false]);
  finish();
  assert.deepEqual([pass(1), playhead.is.playing], [timeline.last, false]);
});

test("story_of_a_fold_that_is_over_tells_nothing", () => {
  const { playhead, story } = told({ playback: 200, growing: false, over: true });
  assert.deepEqual([story.telling, playhead.is.playing], [false, false]);
});

test("story_of_a_page_that_asks_for_no_autoplay_does_not_start", () => {
  const { send, pass, playhead, story } = told();
  Object.assign(globalThis, { addEventListener() {}, location: { hash: "", search: "?autoplay=0" } });
  new Place({ player: { on() {}, send }, view: () => null, colour() {}, path() {} }, false).go();
  assert.equal(pass(3), 0);
  assert.ok(!playhead.is.playing && !story.telling);
});
