// A 3D scene: viser's client in a frame, controlled by the page, and the pointer controls; see
// bridge.js and web/viser/scene_bundle.py. The frame is not trusted: it only reports its progress.
import { rayThrough } from "./camera.js";
import { element } from "../lib/text.js";

const RELOAD_MS = 500; // delay before the first restart of the client
const STILL_PX = { mouse: 4, touch: 10 }; // maximum motion of a tap; chosen
const TURN_RAD = 2 * Math.PI; // for a drag over the height of the view
const ZOOM_PER_PX = 0.0012; // exponent per pixel of wheel motion
const MAX_WHEEL_PX = 400; // per event
const LINE_PX = 33; // pixels per line, for wheels that report lines
const KEY_TURN_RAD = Math.PI / 18; // per key press
const KEY_ZOOM = 1.15; // per key press
/** @type {Record<string, Orbit>} */
export const KEY_ORBITS = {
  w: { turn: [0, KEY_TURN_RAD] },
  a: { turn: [-KEY_TURN_RAD, 0] },
  s: { turn: [0, -KEY_TURN_RAD] },
  d: { turn: [KEY_TURN_RAD, 0] },
  "+": { zoom: 1 / KEY_ZOOM },
  "=": { zoom: 1 / KEY_ZOOM },
  "-": { zoom: KEY_ZOOM },
};
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

export const linear = Uint8Array.from({ length: 256 }, (_, byte) => {
  const v = byte / 255;
  return Math.round(255 * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
});

/**
 * @param {string} name
 * @param {Record<string, unknown>} updates
 * @returns {SceneMessage}
 */
export const update = (name, updates) => ({
  type: "SceneNodeUpdateMessage",
  owner: "",
  name,
  updates,
});
/**
 * @param {string} name
 * @param {boolean} visible
 * @returns {SceneMessage}
 */
export const visibility = (name, visible) => ({
  type: "SetSceneNodeVisibilityMessage",
  owner: "",
  name,
  visible,
});
const removal = (/** @type {string} */ name) => ({
  type: "RemoveSceneNodeMessage",
  owner: "",
  name,
});

/**
 * @param {Eye} eye
 * @returns {SceneMessage[]}
 */
export const cameraTo = ({ position, target }) => [
  { type: "SetCameraPositionMessage", position, initial: false },
  { type: "SetCameraLookAtMessage", look_at: target, initial: false },
];

// Return the CSS color-scheme of the page; see theme.js.
const scheme = () => document.documentElement.dataset.theme ?? "light dark";

// Replace column references in scene messages by the arrays.
/**
 * @param {SceneMessage[]} messages
 * @param {Record<string, Column>} arrays
 * @returns {SceneMessage[]}
 */
function staged(messages, arrays) {
  /**
   * @param {unknown} value
   * @returns {unknown}
   */
  const filled = (value) => {
    if (Array.isArray(value)) return value.map(filled);
    if (value === null || typeof value !== "object") return value;
    if ("column" in value) return arrays[String(value.column)].slice();
    return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, filled(inner)]));
  };
  return messages.map((message) => /** @type {SceneMessage} */ (filled(message)));
}

/** @template {Staged} [Told=Bundle] */
export class Scene {
  /**
   * @param {HTMLIFrameElement} frame
   * @param {SceneHeard} heard
   */
  constructor(frame, heard = {}) {
    this.frame = frame;
    frame.inert = true;
    this.heard = heard;
    this.open = false;
    /** @type {Told | null} */
    this.bundle = null;
    /** @type {Set<string | undefined>} */
    this.nodes = new Set();
    /** @type {MessagePort | null} */
    this.port = null;
    /** @type {Eye | null} */
    this.eye = null; // camera of the visible picture
    this.losses = 0; // number of lost WebGL contexts
    this.asks = 0;
    /** @type {Map<unknown, { event: "pass" | "paint", then: () => void }>} */
    this.requests = new Map();
    frame.addEventListener("load", () => this.connect());
    addEventListener("themechange", () =>
      this.port?.postMessage({ do: "dress", scheme: scheme() }),
    );
  }

  // Replace the scene bundle.
  /** @param {Told} bundle */
  set(bundle) {
    this.bundle = bundle;
    if (this.open) this.build();
  }

  build() {
    if (!this.bundle) return;
    const messages = staged(this.bundle.header.messages, this.bundle.arrays);
    const nodes = new Set(messages.filter(({ props }) => props).map(({ name }) => name));
    const removed = [...this.nodes].filter((name) => !nodes.has(name));
    this.nodes = nodes;
    this.apply([...removed.map((name) => removal(String(name))), ...messages]);
  }

  /** @param {SceneMessage[]} messages */
  apply(messages) {
    this.port?.postMessage({ do: "show", messages });
  }

  // Call back when the last messages to the client are visible.
  /** @param {() => void} then */
  painted(then) {
    this.ask("paint", then);
  }

  // Call back after two animation frames ("pass") or when the scene is painted ("paint").
  /**
   * @param {"pass" | "paint"} event
   * @param {() => void} then
   */
  ask(event, then) {
    this.requests.set(++this.asks, { event, then });
    this.port?.postMessage({ do: event, id: this.asks });
  }

  // Send the loaded client its end of a port. Its opaque origin cannot be named as the target, but
  // the frame only ever loads pages of this service.
  connect() {
    this.port?.close();
    this.open = false;
    this.nodes = new Set();
    const { port1, port2 } = new MessageChannel();
    this.port = port1;
    port1.onmessage = ({ data }) => this.hear(data);
    this.frame.contentWindow?.postMessage({ scheme: scheme() }, "*", [port2]);
    for (const [id, { event }] of this.requests) port1.postMessage({ do: event, id });
  }

  // Restart the client after a lost context, with exponential back-off.
  reload() {
    this.open = false;
    this.heard.lost?.();
    setTimeout(
      () => this.frame.parentNode?.insertBefore(this.frame, this.frame.nextSibling),
      RELOAD_MS * 2 ** this.losses++,
    );
  }

  // Pick at a point of the picture, in pixels from the top left.
  /**
   * @param {number} x
   * @param {number} y
   */
  tap(x, y) {
    const {
      bundle,
      eye,
      frame: { clientWidth: wide, clientHeight: high },
    } = this;
    if (bundle && eye && wide && high)
      this.pick(
        ...rayThrough(
          eye,
          [x / wide, y / high],
          wide / high,
          bundle.header.camera.field_of_view_rad,
        ),
      );
  }

  // Report a click as a ray in the scene.
  /**
   * @param {Vector} origin
   * @param {Vector} direction
   */
  pick(origin, direction) {
    this.heard.pick?.(origin, direction);
  }

  /** @param {ViewTold | null | undefined} message */
  hear(message) {
    switch (message?.is) {
      case "open":
        if (this.open) return;
        this.open = true;
        if (this.bundle) this.build();
        this.heard.open?.();
        return;
      case "lost":
        this.reload();
        return;
      case "done": {
        const request = this.requests.get(message.id);
        this.requests.delete(message.id);
        request?.then();
      }
    }
  }
}

/**
 * @typedef {{ x: number, y: number, fromX: number, fromY: number, button: number, still: number,
 *   drags: boolean }} Finger
 */

// Pointer controls of the camera, on a transparent element above the view, which also has its
// focus. A press without motion is a tap. One pointer turns the camera; with the right or middle
// button it moves the picture. Two pointers zoom and, unless the camera follows the chain, move the
// picture.
export class Hand {
  /**
   * @param {(orbit: Orbit) => void} does
   * @param {{ height: () => number, follows: () => boolean, tap: (x: number, y: number) => void,
   *   scroll?: () => void }} view its height
   *   in pixels; `scroll` is called if the page around an embed scrolls instead of a zoom
   */
  constructor(does, { height, follows, tap, scroll = () => {} }) {
    this.does = does;
    this.height = height;
    this.follows = follows;
    this.tap = tap;
    this.scroll = scroll;
    // True in an embed, where the wheel and vertical swipes scroll the page around it.
    this.yields = false;
    this.clicked = false;
    /** @type {Map<number, Finger>} */
    this.fingers = new Map();
  }

  /** @param {PointerEvent} event */
  hear({ type, pointerId: id, pointerType, offsetX: x, offsetY: y, button }) {
    const { fingers } = this;
    if (type === "pointermove") {
      this.drag(id, x, y);
      return;
    }
    if (type === "pointerdown") {
      for (const finger of fingers.values()) finger.drags = true;
      fingers.set(id, {
        x,
        y,
        fromX: x,
        fromY: y,
        button,
        still: pointerType === "touch" ? STILL_PX.touch : STILL_PX.mouse,
        drags: fingers.size > 0,
      });
      return;
    }
    const finger = fingers.get(id);
    fingers.delete(id);
    if (type === "pointerup" && finger && !finger.drags && finger.button === 0) this.tap(x, y);
  }

  /**
   * @param {number} id
   * @param {number} x
   * @param {number} y
   */
  drag(id, x, y) {
    const finger = this.fingers.get(id);
    if (!finger) return;
    finger.drags ||= Math.hypot(x - finger.fromX, y - finger.fromY) > finger.still;
    if (!finger.drags) return;
    const before = this.spread();
    const [dx, dy] = [(x - finger.x) / this.height(), (y - finger.y) / this.height()];
    Object.assign(finger, { x, y });
    if (this.fingers.size > 1) {
      const after = this.spread();
      /** @type {Orbit} */
      const orbit = before > 0 && after > 0 ? { zoom: before / after } : {};
      if (!this.follows()) orbit.move = [dx / this.fingers.size, -dy / this.fingers.size];
      this.does(orbit);
    } else
      this.does(
        finger.button > 0 ? { move: [dx, -dy] } : { turn: [-TURN_RAD * dx, TURN_RAD * dy] },
      );
  }

  // Return the distance between two pointers.
  spread() {
    const [a, b] = [...this.fingers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  // Cover a view with the element that receives its input.
  /** @param {HTMLElement} view */
  cover(view) {
    const surface = element("div", {
      class: "surface",
      tabindex: 0,
      role: "application",
      "aria-label": "3D view",
    });
    this.surface = surface;
    for (const type of /** @type {const} */ ([
      "pointerdown",
      "pointermove",
      "pointerup",
      "pointercancel",
    ]))
      surface.addEventListener(type, (event) => this.hear(event));
    surface.addEventListener("pointerdown", ({ pointerId }) => {
      this.clicked = true;
      surface.setPointerCapture(pointerId);
    });
    surface.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    // A ring shows that the keyboard has moved the focus here; keys after a click show none.
    surface.addEventListener("focus", () =>
      surface.classList.toggle("focused", surface.matches(":focus-visible")),
    );
    surface.addEventListener("blur", () => {
      this.clicked = false;
      surface.classList.remove("focused");
    });
    // The right button moves the view.
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    view.after(surface);
    return surface;
  }

  /** @param {boolean} on */
  yieldScrolling(on) {
    this.yields = on;
    this.surface?.style.setProperty("touch-action", on ? "pan-y" : "none");
  }

  // After a click, until the focus leaves, or with Ctrl or ⌘, the wheel zooms a view in an embed,
  // too.
  /** @param {WheelEvent} event */
  wheel(event) {
    if (this.yields && !this.clicked && !event.ctrlKey && !event.metaKey) {
      this.scroll();
      return;
    }
    event.preventDefault();
    const by = event.deltaMode ? LINE_PX * event.deltaY : event.deltaY;
    this.does({
      zoom: Math.exp(ZOOM_PER_PX * Math.min(MAX_WHEEL_PX, Math.max(-MAX_WHEEL_PX, by))),
    });
  }
}

// Name of the WebGL renderer; set by hasWebGL.
let renderer = "";

/**
 * Load the page of a 3D view into its frame. The frame is reinserted into the document: after a
 * navigation back it already contains a page, and loading another one would add a history entry
 * and discard those for Forward.
 * @param {HTMLIFrameElement} frame
 * @param {string} href
 */
export function load(frame, href) {
  const { parentNode, nextSibling } = frame;
  frame.remove();
  frame.src = href;
  parentNode?.insertBefore(frame, nextSibling);
}

// Return true if the browser reports software rendering.
export const isSoftware = () => SOFTWARE.test(renderer);

export function hasWebGL() {
  try {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2");
    const info = context?.getExtension("WEBGL_debug_renderer_info");
    if (context && info) renderer = String(context.getParameter(info.UNMASKED_RENDERER_WEBGL));
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context);
  } catch {
    return false;
  }
}
