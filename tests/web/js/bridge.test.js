// The bridge runs before viser's client in its frame. Here the test stands for the page and the
// client, and requests each picture.
import assert from "node:assert/strict";
import { test } from "node:test";

/** What waits for the next picture. */
const waiting = [];
class Context {
  clear() {}
  drawElementsInstanced() {}
}
const page = { name: "the page around the frame" };
const frame = new EventTarget();
const clock = { currentTime: 0 };
const frameDocument = {
  timeline: clock,
  documentElement: Object.assign(new EventTarget(), {
    style: { setProperty() {} },
    classList: { toggle() {} },
  }),
};
Object.assign(globalThis, {
  window: globalThis,
  parent: page,
  WebGL2RenderingContext: Context,
  location: { search: "", hash: "", pathname: "/view" },
  history: { replaceState() {} },
  MutationObserver: class {
    observe() {}
  },
  Element: class {},
  HTMLElement: class {},
  HTMLCanvasElement: class {},
  document: frameDocument,
  addEventListener: frame.addEventListener.bind(frame),
  removeEventListener: frame.removeEventListener.bind(frame),
});
await import("../../../web/static/js/viewer/bridge.js");

const soon = () =>
  new Promise((done) => {
    setTimeout(done, 5);
  });

// Client that applies its messages before it paints.
const client = new globalThis.Worker();
const messages = [];
client.onmessage = ({ data }) => {
  if (data.messages) messages.push(...data.messages.map(({ type, mark }) => mark ?? type));
};

async function paint() {
  clock.currentTime++;
  const sent = messages.splice(0);
  new Context().clear();
  for (const draw of waiting.splice(0)) draw(0);
  return sent.filter((name) => name !== "SetSceneNodeVisibilityMessage");
}

test("the client gets a camera one frame after the poses that it follows", async (t) => {
  // Other test files of this process use them.
  const { document: savedDocument, requestAnimationFrame: next } = globalThis;
  Object.assign(globalThis, {
    document: frameDocument,
    requestAnimationFrame: (draw) => waiting.push(draw),
  });
  t.after(() =>
    Object.assign(globalThis, { document: savedDocument, requestAnimationFrame: next }),
  );
  const { port1, port2 } = new MessageChannel();
  client.postMessage({ type: "set_server" });
  frame.dispatchEvent(
    Object.assign(new Event("message"), { source: page, ports: [port2], data: {} }),
  );
  const show = async (k) => {
    port1.postMessage({
      do: "show",
      messages: [
        { type: "SceneNodeUpdateMessage", mark: `poses ${k}` },
        { type: "SetCameraPositionMessage", mark: `position ${k}` },
        { type: "SetCameraLookAtMessage", mark: `target ${k}` },
      ],
    });
    await soon();
  };
  await soon();
  await show(1);
  assert.deepEqual(await paint(), ["poses 1"]);
  await show(2);
  assert.deepEqual(await paint(), ["position 1", "target 1", "poses 2"]);
  assert.deepEqual(await paint(), ["position 2", "target 2"]); // no further message

  await show(3);
  await show(4); // two frames before one picture: neither poses nor camera of the first are seen
  assert.deepEqual(await paint(), ["poses 3", "poses 4"]);
  assert.deepEqual(await paint(), ["position 4", "target 4"]);
  assert.deepEqual(await paint(), []);
  port1.close();
});
