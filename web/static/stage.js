// The stage: viser's client in a frame, shown what the page says; see bridge.js and web/scenery.py.
const GROUND_GAP = 0.35;
const SINK_S = 0.05;
const RISE_S = 0.5;
const MOVED_PX = 4;
const SEEN_THROUGH = 0.22;

const linear = Uint8Array.from({ length: 256 }, (_, byte) => {
  const v = byte / 255;
  return Math.round(255 * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
});

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

export class Stage {
  // Heard are: open(), pick(origin, direction) in pitches, touch() when the camera was taken hold of, key(event).
  constructor(frame, heard) {
    this.frame = frame;
    this.heard = heard;
    this.open = false;
    this.scenery = null;
    this.latest = null;
    this.ground = null;
    this.camera = null;
    this.through = false;
    this.dressed = null;
    frame.addEventListener("load", () => this.dress());
    this.dress();
  }

  // The scene of another chain.
  set(scenery) {
    this.scenery = scenery;
    this.pitch = scenery.header.pitch;
    this.ground = null;
    this.latest = null;
    if (this.open) this.build();
  }

  build() {
    const { header, arrays } = this.scenery;
    this.apply(staged(header.messages, arrays));
    if (this.through) this.seeThrough(true);
    if (this.latest) this.draw(...this.latest);
  }

  apply(messages) { this.frame.contentWindow.bridge.apply(messages); }

  dress() {
    const inside = this.frame.contentDocument;
    const view = this.frame.contentWindow;
    if (!inside || inside === this.dressed || !view.bridge) return;
    this.dressed = inside;
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

  // What viser's client would tell its server.
  take(message) {
    if (message.type === "ViewerCameraMessage") {
      this.camera = { position: [...message.position], target: [...message.look_at] };
    } else if (message.type === "ScenePointerMessage" && message.ray_origin && this.scenery) {
      this.heard.pick?.(message.ray_origin.map((v) => v / this.pitch), [...message.ray_direction]);
    }
  }

  // Shows poses in colours (3n sRGB bytes); `view` moves the camera, null leaves it.
  draw(snapshot, colours, view) {
    this.latest = [snapshot, colours, view];
    if (!this.open) return;
    const messages = [
      update("/modules", {
        batched_positions: snapshot.positions.map((v) => v * this.pitch),
        batched_wxyzs: snapshot.wxyzs,
        batched_colors: colours.map((byte) => linear[byte]),
      }),
      update("/ends", this.ends(snapshot)),
    ];
    if (this.through) messages.push(update("/path", { points: this.path(snapshot) }));
    if (this.ground !== null) {
      const [x, y] = this.middle(snapshot);
      messages.push({ type: "SetPositionMessage", owner: "", name: "/ground", position: [x * this.pitch, y * this.pitch, this.ground] });
    }
    if (view) {
      messages.push(
        { type: "SetCameraPositionMessage", position: view.position, initial: false },
        { type: "SetCameraLookAtMessage", look_at: view.target, initial: false },
      );
    }
    this.apply(messages);
  }

  // Lets one look through the modules at the way that the chain takes in them.
  seeThrough(on) {
    this.through = on;
    if (!this.open || !this.scenery) return;
    this.apply([
      update("/modules", { opacity: on ? SEEN_THROUGH : null, cast_shadow: !on, receive_shadow: !on }),
      { type: "SetSceneNodeVisibilityMessage", owner: "", name: "/path", visible: on },
    ]);
    if (this.latest) this.draw(...this.latest);
  }

  path({ positions }) {
    const n = positions.length / 3;
    const points = new Float32Array(6 * (n - 1));
    for (let i = 0; i < n - 1; i++) for (let k = 0; k < 6; k++) points[6 * i + k] = positions[3 * i + k] * this.pitch;
    return points;
  }

  middle({ positions }) {
    const n = positions.length / 3;
    const sum = [0, 0];
    for (let i = 0; i < n; i++) { sum[0] += positions[3 * i]; sum[1] += positions[3 * i + 1]; }
    return [sum[0] / n, sum[1] / n];
  }

  // Studs on the free faces: behind the first module, before the last one.
  ends({ positions, wxyzs }) {
    const { shown_size: size, reach } = this.scenery.header;
    const n = positions.length / 3;
    const at = new Float32Array(6);
    const turn = new Float32Array(8);
    [[0, -1], [n - 1, 1]].forEach(([i, side], k) => {
      const [w, x, y, z] = wxyzs.subarray(4 * i, 4 * i + 4);
      const ahead = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)];
      for (let c = 0; c < 3; c++) at[3 * k + c] = (positions[3 * i + c] + side * size * reach * ahead[c]) * this.pitch;
      // Half a turn about z points the first stud backwards.
      turn.set(side < 0 ? [-z, y, -x, w] : [w, x, y, z], 4 * k);
    });
    return { batched_positions: at, batched_wxyzs: turn };
  }

  // Lets the ground sink and rise to just below the chain; true while it moves.
  moveGround(seconds, { positions }) {
    let low = Infinity;
    for (let k = 2; k < positions.length; k += 3) low = Math.min(low, positions[k]);
    low = (low - 0.5 - GROUND_GAP) * this.pitch;
    const before = this.ground ?? low;
    const after = low + (before - low) * Math.exp(-seconds / (low < before ? SINK_S : RISE_S));
    if (this.ground !== null && Math.abs(after - this.ground) < 1e-3 * this.pitch) return false;
    this.ground = after;
    return true;
  }
}

const update = (name, updates) => ({ type: "SceneNodeUpdateMessage", owner: "", name, updates });

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
