// The frame of the 3D view gets the page's theme, and its scene is picked with rays.
import assert from "node:assert/strict";
import { test } from "node:test";
import { Scene } from "../../../web/static/js/viewer/scene.js";

// Page around the frame: its messages, and the chosen theme.
const page = new EventTarget();
globalThis.addEventListener = page.addEventListener.bind(page);
globalThis.document = { documentElement: { dataset: {} } };

test("the view has the page's light or dark theme from the start", () => {
  const scene = new Scene(new EventTarget(), {});
  const posted = [];
  scene.frame.contentWindow = { postMessage: ({ scheme }) => posted.push(scheme) };
  document.documentElement.dataset.theme = "dark";
  scene.connect();
  scene.port.postMessage = ({ do: action, scheme }) => posted.push(action, scheme);
  delete document.documentElement.dataset.theme;
  page.dispatchEvent(new Event("themechange"));
  scene.port.close();
  assert.deepEqual(posted, ["dark", "dress", "light dark"]);
});

test("invalid messages from the view are ignored", () => {
  const scene = new Scene(new EventTarget(), {});
  for (const invalid of [
    null,
    1,
    "open",
    [],
    {},
    { is: "constructor" },
    { is: "done", id: "x" },
    { is: "key", key: "F5" },
  ])
    scene.hear(invalid);
  assert.equal(scene.open, false);
});

test("a tap sends a ray from the shown camera through that point of the picture", () => {
  const scene = new Scene(
    Object.assign(new EventTarget(), { clientWidth: 200, clientHeight: 100 }),
    {},
  );
  const rays = [];
  scene.pick = (...ray) => rays.push(ray);
  scene.bundle = { header: { camera: { field_of_view_rad: Math.PI / 2 } } };
  scene.tap(100, 50); // the camera is still unknown
  scene.eye = { position: [5, 0, 0], target: [0, 0, 0] };
  scene.tap(100, 50);
  scene.tap(200, 0); // seen from +x, +y is on the right and twice as far away as +z is up
  const [middle, corner] = rays.map(([, direction]) =>
    direction.map((v) => Math.round(1e6 * v) / 1e6),
  );
  assert.deepEqual(
    rays.map(([origin]) => origin),
    [
      [5, 0, 0],
      [5, 0, 0],
    ],
  );
  assert.deepEqual(middle.map(Math.abs), [1, 0, 0]);
  const unit = Math.sqrt(6);
  assert.deepEqual(
    corner,
    [-1 / unit, 2 / unit, 1 / unit].map((v) => Math.round(1e6 * v) / 1e6),
  );
});
