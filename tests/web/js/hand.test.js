// Control of the camera by pointers and wheels.
import assert from "node:assert/strict";
import { test } from "node:test";
import { Hand } from "../../../web/static/js/viewer/scene.js";
import { close } from "./vectors.js";

function handWith(follows = true) {
  const done = [];
  const hand = new Hand((orbit) => done.push(orbit), {
    height: () => 100,
    follows: () => follows,
    tap: (...place) => done.push({ tap: place }),
  });
  const say = (type, offsetX = 0, offsetY = 0, properties = {}) =>
    hand.hear({ type, pointerId: 1, offsetX, offsetY, button: 0, ...properties });
  return { done, hand, say };
}

test("a drag turns the camera only when it is longer than a click", () => {
  const { done, say } = handWith();
  say("pointermove", 50, 50); // no button is pressed
  say("pointerdown", 10, 10);
  say("pointermove", 12, 11);
  assert.deepEqual(done, []);
  say("pointermove", 35, 10);
  close(done[0].turn, [-Math.PI / 2, 0]);
  say("pointerup");
  say("pointermove", 90, 90);
  assert.equal(done.length, 1);
});

test("the right button moves the picture and a wheel zooms", () => {
  const { done, hand, say } = handWith();
  say("pointerdown", 0, 0, { button: 2 });
  say("pointermove", 10, 20);
  close(done[0].move, [0.1, -0.2]);
  for (const deltaY of [100, -100]) hand.wheel({ deltaY, preventDefault() {} });
  close([done[1].zoom * done[2].zoom], [1]);
  assert.ok(done[1].zoom > 1); // farther
});

test("two fingers zoom and move the picture only where nothing is followed", () => {
  for (const follows of [true, false]) {
    const { done, say } = handWith(follows);
    say("pointerdown", 40, 0);
    say("pointerdown", 60, 0, { pointerId: 2 });
    say("pointermove", 80, 0, { pointerId: 2 });
    close([done[0].zoom], [0.5]);
    assert.equal("move" in done[0], !follows);
    assert.equal(done[0].turn, undefined);
  }
});

test("a press that hardly moves is a tap of one finger or of the main button", () => {
  const { done, say } = handWith();
  const press = (x, properties) => {
    done.splice(0);
    say("pointerdown", 10, 10, properties);
    say("pointermove", x, 10, properties);
    say("pointerup", x, 10, properties);
    return done.map((action) => Object.keys(action)[0]);
  };
  assert.deepEqual(press(13), ["tap"]);
  assert.deepEqual(done, [{ tap: [13, 10] }]);
  assert.deepEqual(press(18), ["turn"]);
  assert.deepEqual(press(18, { pointerType: "touch" }), ["tap"]);
  assert.deepEqual(press(13, { button: 2 }), []);
  say("pointerdown", 90, 10, { pointerId: 2 });
  assert.deepEqual(press(10), ["zoom"]);
  say("pointerup", 90, 10, { pointerId: 2 });
  assert.equal(done.length, 1);
});
