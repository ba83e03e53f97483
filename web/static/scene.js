// A 3D scene: viser's client in a frame, shown what the page says; see bridge.js and web/scenery.py.
const MOVED_PX = 4;
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

export const linear = Uint8Array.from({ length: 256 }, (_, byte) => {
  const v = byte / 255;
  return Math.round(255 * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
});

export const update = (name, updates) => ({ type: "SceneNodeUpdateMessage", owner: "", name, updates });
export const visibility = (name, visible) => ({ type: "SetSceneNodeVisibilityMessage", owner: "", name, visible });
const removal = (name) => ({ type: "RemoveSceneNodeMessage", owner: "", name });

export const cameraTo = ({ position, target }) => [
  { type: "SetCameraPositionMessage", position, initial: false },
  { type: "SetCameraLookAtMessage", look_at: target, initial: false },
];

// The scene's messages with their arrays in place.
function staged(messages, arrays) {
  const filled = (value) => {
    if (Array.isArray(value)) return value.map(filled);
    if (value === null || typeof value !== "object") return value;
    if ("column" in value) return arrays[value.column].slice();
    return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, filled(inner)]));
  };
  return messages.map(filled);
}

export class Scene {
  // Heard are: open(), touch() when the camera was taken hold of, key(event).
  constructor(frame, heard) {
    this.frame = frame;
    this.heard = heard;
    this.open = false;
    this.scenery = null;
    this.nodes = new Set();
    this.camera = null;
    this.dressed = null;
    frame.addEventListener("load", () => this.dress());
    this.dress();
  }

  // Another scenery in place of the one before.
  set(scenery) {
    this.scenery = scenery;
    if (this.open) this.build();
  }

  build() {
    const messages = staged(this.scenery.header.messages, this.scenery.arrays);
    const nodes = new Set(messages.filter(({ props }) => props).map(({ name }) => name));
    const gone = [...this.nodes].filter((name) => !nodes.has(name));
    this.nodes = nodes;
    this.apply([...gone.map(removal), ...messages]);
  }

  apply(messages) { this.frame.contentWindow.bridge.apply(messages); }

  dress() {
    const inside = this.frame.contentDocument;
    const view = this.frame.contentWindow;
    if (!inside || inside === this.dressed || !view.bridge) return;
    this.dressed = inside;
    this.nodes = new Set();
    const opened = () => {
      this.open = true;
      if (this.scenery) this.build();
      this.heard.open?.();
    };
    view.bridge.onmessage = (message) => this.take(message);
    view.bridge.onopen = opened;
    if (view.bridge.open) opened();
    view.addEventListener("keydown", (event) => this.heard.key?.(event), { capture: true });
    let start = null;
    const forget = () => { start = null; };
    view.addEventListener("pointerdown", (event) => { start = [event.clientX, event.clientY]; }, { capture: true });
    view.addEventListener("pointerup", forget, { capture: true });
    view.addEventListener("pointercancel", forget, { capture: true });
    view.addEventListener("pointermove", (event) => {
      if (!start || !event.buttons) return;
      if (Math.hypot(event.clientX - start[0], event.clientY - start[1]) > MOVED_PX) { forget(); this.heard.touch?.(); }
    }, { capture: true });
    view.addEventListener("wheel", () => this.heard.touch?.(), { capture: true, passive: true });
  }

  // Whether its graphics are software, as far as the browser tells.
  get software() {
    const context = this.frame.contentDocument?.querySelector("canvas")?.getContext("webgl2");
    const told = context?.getExtension("WEBGL_debug_renderer_info");
    return Boolean(told) && SOFTWARE.test(context.getParameter(told.UNMASKED_RENDERER_WEBGL));
  }

  // What viser's client would tell its server.
  take(message) {
    if (message.type === "ViewerCameraMessage") {
      this.camera = { position: [...message.position], target: [...message.look_at] };
    } else if (message.type === "ScenePointerMessage" && message.ray_origin && this.scenery) {
      this.pick([...message.ray_origin], [...message.ray_direction]);
    }
  }
}

export function hasWebGL() {
  try {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context);
  } catch {
    return false;
  }
}
