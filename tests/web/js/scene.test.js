// Messages of the 3D view's frame are validated.
import assert from "node:assert/strict";
import { test } from "node:test";
import { Scene } from "../../../web/static/js/viewer/scene.js";

// Keyboard event of the frame, like a browser's.
globalThis.KeyboardEvent ??= class extends Event {
  constructor(type, { key, shiftKey, ...options }) {
    super(type, options);
    Object.assign(this, { key, shiftKey });
  }
};

// Page around the frame: its messages, and the chosen theme.
const page = new EventTarget();
globalThis.addEventListener = page.addEventListener.bind(page);
globalThis.document = { documentElement: { dataset: {} } };

const POINTER = { kind: "pointermove", id: 1, x: 20, y: 30, by: 0, button: -1, touch: false };

function listening() {
  const received = [];
  const keys = [];
  const frame = new EventTarget();
  frame.addEventListener("keydown", ({ key, shiftKey }) => keys.push([key, shiftKey]));
  const scene = new Scene(frame, { pointer: (pointer) => received.push(pointer) }, { keys: ["End"] });
  scene.bundle = {};
  return { scene, received, keys };
}

test("invalid messages from the view are ignored", () => {
  const { scene, received, keys } = listening();
  const bad = [[NaN, 0, 0], [0, 0, Infinity], [1e300, 0, 0], [0, 0], [0, 0, 0, 0], "abc", null, ["1", "2", "3"], { length: 3 }, [[], [], []], new Float32Array(3)];
  for (const vector of bad) {
    scene.hear({ is: "pointer", pointer: { ...POINTER, x: vector } });
    scene.hear({ is: "pointer", pointer: vector });
    scene.hear({ is: "camera", position: vector, target: [0, 0, 0] });
    scene.hear({ is: "camera", position: [0, 0, 1], target: vector });
  }
  for (const invalid of [
    null, 1, "open", [], {}, { is: "constructor" }, { is: "done", id: "x" }, { is: "key", key: "F5" }, { is: "key", key: ["End"] },
  ]) scene.hear(invalid);
  assert.deepEqual([received, keys], [[], []]);
});

test("valid messages from the view are accepted", () => {
  const { scene, received, keys } = listening();
  scene.hear({ is: "pointer", pointer: POINTER });
  scene.hear({ is: "camera", position: [1, 2, 3], target: [0, 0, 0] });
  scene.hear({ is: "key", key: "End", shift: "yes" });
  assert.deepEqual(received, [POINTER]);
  assert.deepEqual(scene.camera, { position: [1, 2, 3], target: [0, 0, 0] });
  assert.deepEqual(keys, [["End", false]]);
});

test("the view has the page's light or dark theme from the start", () => {
  const { scene } = listening();
  const posted = [];
  scene.frame.contentWindow = { postMessage: ({ scheme }) => posted.push(scheme) };
  document.documentElement.dataset.theme = "dark";
  scene.connect();
  scene.port.postMessage = ({ do: what, scheme }) => posted.push(what, scheme);
  delete document.documentElement.dataset.theme;
  page.dispatchEvent(new Event("themechange"));
  scene.port.close();
  assert.deepEqual(posted, ["dark", "dress", "light dark"]);
});

test("a tap sends a ray from the shown camera through that point of the picture", () => {
  const scene = new Scene(Object.assign(new EventTarget(), { clientWidth: 200, clientHeight: 100 }), {});
  const rays = [];
  scene.pick = (...ray) => rays.push(ray);
  scene.bundle = { header: { camera: { field_of_view_rad: Math.PI / 2 } } };
  scene.tap(100, 50); // the camera is still unknown
  scene.hear({ is: "camera", position: [5, 0, 0], target: [0, 0, 0] });
  scene.tap(100, 50);
  scene.tap(200, 0); // seen from +x, +y is on the right and twice as far away as +z is up
  const [middle, corner] = rays.map(([, direction]) => direction.map((v) => Math.round(1e6 * v) / 1e6));
  assert.deepEqual(rays.map(([origin]) => origin), [[5, 0, 0], [5, 0, 0]]);
  assert.deepEqual(middle.map(Math.abs), [1, 0, 0]);
  const unit = Math.sqrt(6);
  assert.deepEqual(corner, [-1 / unit, 2 / unit, 1 / unit].map((v) => Math.round(1e6 * v) / 1e6));
});
