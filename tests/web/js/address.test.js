// Address of a view.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  cameraIn,
  cameraText,
  hashOf,
  shortOf,
  viewIn,
} from "../../../web/static/js/player/address.js";

const NOTHING = viewIn("");
const FULL = {
  ...NOTHING,
  frame: 11,
  module: 3,
  from: 7,
  to: 19,
  loop: true,
  camera: { azimuth: -1, elevation: 0.5, zoom: 1.25, offset: [0.1, -0.2] },
  colour: "speed",
  path: true,
  follow: false,
  speed: 2,
  play: true,
};

test("a hash gives a moment; frames and modules count from 1", () => {
  assert.deepEqual(viewIn("#frame=12&module=4"), { ...NOTHING, frame: 11, module: 3, named: true });
  assert.deepEqual(viewIn("#frame=0"), { ...NOTHING, frame: 0, named: true });
  assert.deepEqual(viewIn("#from=8&to=20"), { ...NOTHING, from: 7, to: 19 });
  assert.deepEqual(viewIn("#to=20"), { ...NOTHING, to: 19 });
});

test("invalid parts of a hash are ignored", () => {
  for (const hash of [
    "#module=x",
    "#module=12345678901",
    "#from=20&to=20",
    "#from=9&to=8",
    "#from=NaN&to=-4",
    "#from=1.5",
    "#speed=1e9",
    "#speed=-2",
    "#play=yes",
    "#theme=pink",
  ])
    assert.deepEqual(viewIn(hash), NOTHING, hash);
  for (const camera of [
    "1",
    "1,2",
    "1,2,0",
    "1,2,-3",
    "1,2,NaN",
    "a,2,3",
    "1,2,3,4",
    "1,2,3,4,5,6",
    "1e9,2,3",
    "1,2,Infinity",
    "1,2,",
  ])
    assert.equal(cameraIn(camera), null, camera);
  assert.equal(viewIn("#colour=%3Cscript%3E").colour, null);
});

test("a view is read from a hash as it was written", () => {
  const { camera, named, ...fields } = viewIn(hashOf(FULL, "dark"));
  assert.ok(named);
  // A loop with ends loops.
  assert.deepEqual({ ...fields, camera: FULL.camera, named: false, loop: true }, FULL);
  assert.equal(cameraText(camera), cameraText(FULL.camera));
  assert.ok(
    hashOf(FULL, "dark").endsWith("&colour=speed&path=1&follow=0&speed=2&play=1&theme=dark"),
  );
});

test("a hash leaves out default values", () => {
  assert.equal(
    hashOf({
      ...NOTHING,
      frame: 11,
      camera: { azimuth: null, elevation: null, zoom: 1, offset: null },
      colour: "chain",
    }),
    "#frame=12",
  );
  assert.equal(
    hashOf({ ...NOTHING, camera: { azimuth: null, elevation: null, zoom: 1.5, offset: null } }),
    "#camera=,,1.5",
  );
  assert.equal(hashOf(NOTHING), "");
  const coloured = { ...NOTHING, colour: "module" };
  assert.equal(hashOf(coloured, "", "module"), "");
  assert.equal(hashOf(coloured), "#colour=module");
  assert.equal(shortOf(FULL), "12,-57.3,28.65,1.25,0.1,-0.2");
});
