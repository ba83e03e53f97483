// A camera that a visitor turns and zooms continues to follow the chain, and no module is cut off.
import assert from "node:assert/strict";
import { test } from "node:test";
import { cameraText } from "../../../web/static/js/player/address.js";
import { Player } from "../../../web/static/js/player/player.js";
import { axesOf } from "../../../web/static/js/viewer/camera.js";
import { close, random, recorded, turnOfEvents, vectors } from "./vectors.js";

const EVERY = 10; // frames
const CORNERS = [-0.5, 0.5].flatMap((x) =>
  [-0.5, 0.5].flatMap((y) => [-0.5, 0.5].map((z) => [x, y, z])),
);
const due = [];
let now = 0;

function draw(pictures) {
  for (let k = 0; k < pictures && due.length; k++) {
    now += 1000 / 30;
    for (const then of due.splice(0)) then(now);
  }
}

async function playerOf(recording = vectors.timeline, options = {}) {
  globalThis.requestAnimationFrame = (then) => due.push(then);
  const { timeline } = await recorded(recording);
  const player = new Player(timeline, options);
  player.colourBy = (colouring) => {
    player.colouring = colouring;
  };
  await turnOfEvents();
  draw(200);
  return { timeline, player };
}

// Count the corners of modules outside the picture, or behind panels that cover parts of it.
function outside({ rig, snapshot, timeline }, covered = 0, above = 0) {
  const { view } = rig;
  const { field, aspect } = rig.seeing();
  const [right, up, out] = axesOf(view.azimuth, view.elevation);
  const {
    header: { sketch, pitch },
  } = timeline.bundle;
  const corners = timeline.chain.cells ? CORNERS : sketch.parts[0].corners;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  let count = 0;
  for (let i = 0; i < timeline.chain.modules; i++) {
    const [w, x, y, z] = snapshot.wxyzs.subarray(4 * i, 4 * i + 4);
    for (const [a, b, c] of corners) {
      const [u, v, t] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
      const at = [a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u];
      const off = at.map(
        (value, k) => (value + snapshot.positions[3 * i + k]) * pitch - view.target[k],
      );
      const depth = view.distance - dot(off, out);
      const tall = Math.tan(field / 2) * depth;
      if (
        depth <= 0 ||
        dot(off, up) > (1 - 2 * above) * tall ||
        dot(off, up) < (2 * covered - 1) * tall ||
        Math.abs(dot(off, right)) > tall * aspect
      )
        count++;
    }
  }
  return count;
}

test("the followed chain stays between panels", async () => {
  const { player, timeline } = await playerOf(vectors.films[0], { aspect: () => 1.6, calm: true });
  const ends = [0, timeline.last >> 1, timeline.last];
  const hidden = (...covered) =>
    ends.map((frame) => {
      player.cover(...covered);
      player.send({ do: "seek", frame });
      draw(1);
      return outside(player, 0.4, 0.2);
    });
  assert.ok(hidden(0).some((count) => count > 0));
  assert.ok(hidden(0.4).some((count) => count > 0));
  assert.deepEqual(hidden(0.4, 0.2), [0, 0, 0]);
});

const part = (low, high) => low + ((high - low) * random(10_000)) / 10_000;

for (const film of vectors.films) {
  test(`no corner of ${film.name} is outside of the picture while it is followed`, async () => {
    let aspect = 1.6;
    const { player, timeline } = await playerOf(film, { aspect: () => aspect, calm: true });
    for (let frame = 0; frame <= timeline.last; frame += EVERY) {
      aspect = [1.6, 0.6, 2.4][random(3)];
      player.send({ do: "seek", frame });
      player.send({
        do: "orbit",
        turn: [part(-3, 3), part(-1.5, 1.5)],
        zoom: part(0.2, 1.5),
        gently: random(2) === 0,
      });
      draw(1 + random(3)); // also in motion
      assert.equal(outside(player), 0, `frame ${frame}`);
      assert.ok(player.is.follow);
    }
    player.send({ do: "seek", frame: 0 });
    player.send({ do: "play" });
    for (let k = 0; k < 60; k++) {
      draw(1);
      assert.equal(outside(player), 0, `played, picture ${k}`);
    }
  });
}

test("a turned and zoomed camera stays so in other frames until it is reset", async () => {
  const { player, timeline } = await playerOf();
  const usual = player.rig.view;
  player.send({ do: "orbit", turn: [0.5, 0.2], zoom: 2 });
  draw(200);
  const turned = player.rig.view;
  close([turned.azimuth, turned.elevation], [usual.azimuth + 0.5, usual.elevation + 0.2]);
  assert.ok(turned.distance > 1.7 * usual.distance);
  player.send({ do: "seek", frame: timeline.last });
  draw(200);
  close([player.rig.view.azimuth], [turned.azimuth]);
  player.send({ do: "seek", frame: 0 });
  player.send({ do: "camera", camera: null });
  draw(200);
  close([player.rig.view.azimuth, player.rig.view.distance], [usual.azimuth, usual.distance]);
});

test("zooming in ends where the chain would be cut off, and zooming out begins at once", async () => {
  const { player } = await playerOf();
  for (let k = 0; k < 20; k++) player.send({ do: "orbit", zoom: 0.7 });
  draw(200);
  const near = player.rig.view.distance;
  assert.equal(outside(player), 0);
  player.send({ do: "orbit", zoom: 1.1 });
  draw(200);
  close([player.rig.view.distance], [1.1 * near], { rtol: 1e-3 });
});

test("moving the picture ends following, and Follow continues from that direction", async () => {
  const { player, timeline } = await playerOf();
  player.send({ do: "orbit", turn: [0.7, 0] });
  player.send({ do: "orbit", move: [0.2, 0.1] });
  assert.equal(player.is.follow, false);
  const { position } = player.rig.eye;
  player.send({ do: "seek", frame: timeline.last });
  draw(200);
  assert.deepEqual(player.rig.eye.position, position);
  const { azimuth } = player.rig.view;
  player.send({ do: "set", follow: true });
  draw(200);
  close([player.rig.view.azimuth], [azimuth]);
  assert.equal(outside(player), 0);
});

test("a camera in an address shows the same view in another player", async () => {
  for (const orbits of [
    [{ turn: [0.7, -0.3] }, { zoom: 1.7 }],
    [{ zoom: 1.3 }],
    [{ turn: [1, 0.4], zoom: 1.2 }, { move: [0.2, -0.1] }, { zoom: 0.6 }],
  ]) {
    const [{ player: first }, { player: second }] = [await playerOf(), await playerOf()];
    first.send({ do: "seek", frame: 40 });
    for (const orbit of orbits) first.send({ do: "orbit", ...orbit });
    draw(200);
    const camera = first.rig.at(first.snapshot);
    second.send({ do: "set", follow: first.is.follow });
    second.send({ do: "seek", frame: 40 });
    second.send({ do: "camera", camera });
    draw(200);
    // The direction and position of the camera are visible, the distance of its target is not.
    close(second.rig.eye.position, first.rig.eye.position, {
      atol: 1e-6 * first.rig.view.distance,
    });
    close(
      [second.rig.view.azimuth, second.rig.view.elevation],
      [first.rig.view.azimuth, first.rig.view.elevation],
    );
    assert.equal(cameraText(second.rig.at(second.snapshot)), cameraText(camera));
  }
});
