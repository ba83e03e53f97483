import assert from "node:assert/strict";
import { test } from "node:test";
import { Place } from "../../../web/static/js/player/address.js";
import { Playhead } from "../../../web/static/js/player/playhead.js";
import { Story } from "../../../web/static/js/player/story.js";

const TICK_S = 1 / 30;
const EXPLOSION = 500;

// Fold with a number of frames in each phase, and the frames that its page shows over time.
function storyOf({
  explosion = EXPLOSION,
  playback = 0,
  growing = true,
  over = false,
  calm = false,
} = {}) {
  const timeline = { growing, over, windowed: false, outline: { phases: [] }, last: 0 };
  const playhead = new Playhead(timeline);
  const story = new Story(playhead, timeline, calm);
  playhead.story = story;
  const has = (exploded, played) => {
    timeline.outline.phases = [{ name: "explosion", from: 0, to: exploded }];
    if (played)
      timeline.outline.phases.push({ name: "playback", from: exploded, to: exploded + played });
    timeline.last = exploded + played - 1;
  };
  let now = 0;
  const pass = (seconds, onTick = () => {}) => {
    for (let k = 0; k < Math.round(seconds / TICK_S); k++) {
      now += TICK_S;
      story.advance(TICK_S);
      playhead.advance(TICK_S, now);
      onTick(k * TICK_S);
    }
    return playhead.frame;
  };
  const finish = () => {
    Object.assign(timeline, { growing: false, over: true });
    story.settled();
  };
  const send = (message) => {
    story.heard(message);
    playhead.do(message);
  };
  has(explosion, playback);
  story.begun();
  return { timeline, playhead, story, has, pass, finish, send };
}

for (const frames of [100, EXPLOSION, 4000]) {
  test(`an explosion of ${frames} frames plays in four to six seconds`, () => {
    const { pass, playhead } = storyOf({ explosion: frames });
    assert.ok(pass(4) < frames - 1);
    assert.ok(pass(2.5) > frames - 2, `frame ${playhead.frame}`);
    assert.ok(playhead.is.playing);
  });
}

test("an explosion that arrives at once plays without jumps", () => {
  const { has, pass, playhead } = storyOf({ explosion: 5 });
  let before = playhead.frame;
  let maxStep = 0;
  let moved = false;
  const look = () => {
    maxStep = Math.max(maxStep, playhead.frame - before);
    moved ||= playhead.frame > 0.5;
    before = playhead.frame;
  };
  pass(0.5, look);
  assert.ok(moved); // with five frames it is in motion
  has(EXPLOSION, 0);
  pass(2, look);
  has(EXPLOSION, 80);
  pass(6, look);
  assert.ok(maxStep <= (1.2 * EXPLOSION * TICK_S) / 5, `${maxStep} frames in one picture`);
});

test("the story waits at the newest frame until there are more", () => {
  const { has, pass, playhead } = storyOf({ explosion: 40 });
  pass(9);
  assert.ok(playhead.frame > 38.9 && playhead.frame <= 39);
  const frame = playhead.frame;
  pass(1);
  assert.equal(playhead.frame, frame); // nothing is drawn while it waits
  has(80, 0);
  assert.ok(pass(1) > 45);
});

test("after the verdict the fold plays once from straight, then rests", () => {
  const { timeline, playhead, story, pass, finish } = storyOf({ playback: 200 });
  pass(20);
  timeline.growing = false;
  pass(1);
  finish();
  assert.deepEqual([playhead.frame, playhead.is.playing], [EXPLOSION, true]);
  assert.ok(pass(3) < timeline.last - 50);
  pass(9);
  assert.deepEqual(
    [playhead.frame, playhead.is.playing, story.telling],
    [timeline.last, false, false],
  );
  pass(5);
  assert.equal(playhead.frame, timeline.last);
});

test("a verdict during the explosion plays on to the finished shape", () => {
  const { timeline, playhead, pass, finish } = storyOf({ playback: 200 });
  const frame = pass(2);
  finish();
  assert.equal(playhead.frame, frame);
  assert.ok(pass(1) > frame);
  pass(15);
  assert.deepEqual([playhead.frame, playhead.is.playing], [timeline.last, false]);
});

for (const message of [
  { do: "seek", frame: 40 },
  { do: "step", by: 1 },
  { do: "pause" },
  { do: "set", live: true },
]) {
  test(`the story does not interrupt a visitor who sends ${message.do}`, () => {
    const { playhead, story, pass, send, finish } = storyOf({ playback: 200 });
    pass(2);
    send(message);
    const {
      frame,
      is: { playing },
    } = playhead;
    finish();
    assert.deepEqual(
      [playhead.frame, playhead.is.playing, story.framesPerSecond],
      [frame, playing, null],
    );
  });
}

test("the story goes on if the address has no view", () => {
  const { story, send } = storyOf();
  send({ do: "select", module: null });
  send({ do: "set", from: null, to: null, loop: false, speed: 1, follow: true });
  assert.ok(story.telling);
  send({ do: "set", from: null, to: 9 });
  assert.ok(!story.telling);
});

test("the verdict does not reset a view that was turned", () => {
  const { timeline, playhead, story, pass, finish } = storyOf({ playback: 200 });
  story.heard({ do: "orbit", turn: [1, 0] });
  pass(30);
  finish();
  pass(1);
  assert.deepEqual([playhead.frame, playhead.is.playing], [timeline.last, false]);
});

test("a restarted timeline starts over, except for a visitor who went to another frame", () => {
  const { playhead, story, pass, send } = storyOf();
  pass(3);
  story.begun();
  assert.deepEqual([playhead.frame, playhead.is.playing], [0, true]);
  assert.ok(pass(2) > 50);
  send({ do: "seek", frame: 7 });
  story.begun();
  assert.deepEqual([playhead.frame, playhead.is.playing], [7, false]);
});

test("with reduced motion the story shows the first frame, and the finished shape at the verdict", () => {
  const { timeline, playhead, pass, finish } = storyOf({ playback: 200, calm: true });
  assert.deepEqual([pass(5), playhead.is.playing], [0, false]);
  finish();
  assert.deepEqual([pass(1), playhead.is.playing], [timeline.last, false]);
});

test("a finished fold has no story", () => {
  const { playhead, story } = storyOf({ playback: 200, growing: false, over: true });
  assert.deepEqual([story.telling, playhead.is.playing], [false, false]);
});

test("the address says whether the motion plays", () => {
  const { send, pass, playhead, story } = storyOf();
  const go = (search) => {
    Object.assign(globalThis, { addEventListener() {}, location: { hash: "", search } });
    new Place({ player: { on() {}, send }, view: () => null, colour() {}, path() {} }, false).go();
  };
  go("?autoplay=0");
  assert.equal(pass(3), 0);
  assert.ok(!playhead.is.playing && !story.telling);
  go("?autoplay=1");
  assert.ok(pass(1) > 0);
});
