// The 3D scene of a fold, which receives poses, colours and a camera for each frame.
import { Scene, cameraTo, linear, update, visibility } from "./scene.js";
import { buriedBy } from "../player/kinematics.js";
import { membersOf, quaternionOf, times, turned, valuesOf } from "./camera.js";
import { floorUnder, tableColours } from "./sketch.js";

const SINK_S = 0.05;
const RISE_S = 0.5;
const LEVEL = 0.01; // distance in pitches at which the ground snaps to its target
const SEEN_THROUGH = 0.22;
const NOWHERE = -1e6;

// Discs on the table that show the contact forces of modules.
const ABOVE = 0.02; // height of the lowest disc above the table, in pitches
const APART = 0.002; // distance between two discs in pitches, which avoids z-fighting
const AREA = 0.62; // radius of the disc for a force of one module weight, in pitches
const LEAST = 0.05; // module weights; smaller forces have no disc

/** @typedef {[Snapshot, Uint8Array, Eye]} Picture */

/** @extends {Scene<Bundle>} */
export class Stage extends Scene {
  // In addition to the events of Scene, `heard` receives pick(origin, direction) in pitches.
  /**
   * @param {HTMLIFrameElement} frame
   * @param {SceneHeard} heard
   */
  constructor(frame, heard) {
    super(frame, heard);
    /** @type {Picture | null} */
    this.latest = null;
    /** @type {number | null} */
    this.ground = null;
    this.pitch = 1;
    /** @type {Uint8Array | null} */
    this.sent = null;
    this.through = false;
    /** @type {Int32Array | null} */
    this.buried = null;
    this.detached = false;
    /** @type {[piece: number, members: number[]][]} */
    this.members = []; // the modules of each node
    /** @type {((shown: Snapshot) => Floats | null) | null} */
    this.pressed = null; // returns the contact forces on the table, if they are displayed
    addEventListener("themechange", () => this.dress());
  }

  /** @returns {TableTold | null} */
  get table() {
    return this.bundle?.header.table ?? null;
  }

  // Apply the theme of the page to the table.
  dress() {
    if (this.open && this.table) this.apply([update("/table", { color: tableColours().lit })]);
  }

  // Set the scene of another chain.
  /** @param {Bundle} bundle */
  set(bundle) {
    this.pitch = bundle.header.pitch;
    const { table } = bundle.header;
    this.ground = table ? table.height * this.pitch : null;
    this.latest = null;
    this.sent = null;
    this.members = membersOf(bundle.header.chain);
    this.buried = bundle.neighbours
      ? buriedBy(bundle.neighbours, bundle.header.chain.modules)
      : null;
    super.set(bundle);
  }

  build() {
    super.build();
    this.sent = null;
    this.detached = false;
    this.dress();
    if (this.through) this.seeThrough(true);
    if (this.latest) this.draw(...this.latest);
  }

  /**
   * @param {Vector} origin
   * @param {Vector} direction
   */
  pick(origin, direction) {
    this.heard.pick?.(
      [origin[0] / this.pitch, origin[1] / this.pitch, origin[2] / this.pitch],
      direction,
    );
  }

  // Draw poses with colours (3n sRGB bytes) from a camera.
  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   * @param {Eye} eye
   */
  draw(snapshot, colours, eye) {
    this.latest = [snapshot, colours, eye];
    if (!this.open) return;
    const messages = [...this.modules(snapshot, colours), update("/ends", this.ends(snapshot))];
    if (this.detached) messages.push(...this.seen.map((name) => visibility(name, true)));
    this.detached = false;
    if (this.through) messages.push(update("/path", { points: this.path(snapshot) }));
    if (this.table) messages.push(...this.pressing(snapshot, colours));
    else if (this.ground !== null) {
      const [x, y] = this.middle(snapshot);
      messages.push({
        type: "SetPositionMessage",
        owner: "",
        name: "/ground",
        position: [x * this.pitch, y * this.pitch, this.ground],
      });
    }
    messages.push(...cameraTo(eye));
    this.apply(messages);
  }

  // Hide the expensive nodes until the next `draw`, while the page's drawing covers the view:
  // viser's client still draws once a second.
  rest() {
    if (this.detached || !this.open) return;
    this.detached = true;
    this.apply(this.seen.map((name) => visibility(name, false)));
  }

  // Nodes that are expensive to draw.
  get seen() {
    return [...this.nodesOfPieces, this.table ? "/table" : "/ground"];
  }

  // Nodes of the modules: one for each kind of piece.
  get nodesOfPieces() {
    return this.bundle?.header.nodes ?? [];
  }

  // Return messages for the discs under the modules on the table, in the colours of the modules.
  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   */
  pressing(snapshot, colours) {
    const forces = this.pressed?.(snapshot);
    if (!forces || !this.table) return [visibility("/pressed", false)];
    const { places, scales } = discs(forces, snapshot.positions, this.table.height, this.pitch);
    return [
      update("/pressed", {
        batched_positions: places,
        batched_scales: scales,
        batched_colors: colours.map((byte) => linear[byte]),
      }),
      visibility("/pressed", true),
    ];
  }

  // Return updates of the modules; colours are sent only if they have changed.
  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   */
  modules(snapshot, colours) {
    const positions = this.positions(snapshot);
    const { sent } = this;
    const recoloured = !sent || colours.some((byte, k) => byte !== sent[k]);
    const bytes = recoloured ? colours.map((byte) => linear[byte]) : null;
    this.sent = colours;
    return this.members.map(([, members], k) =>
      update(this.nodesOfPieces[k], {
        batched_positions: valuesOf(positions, members, 3),
        batched_wxyzs: valuesOf(snapshot.wxyzs, members, 4),
        ...(bytes && { batched_colors: valuesOf(bytes, members, 3) }),
      }),
    );
  }

  // Return the positions of the modules. Buried ones are moved
  // out of sight, because viser draws only what is in view.
  /** @param {WindowPoses} poses */
  positions({ positions, core = 0 }) {
    const centres = positions.map((v) => v * this.pitch);
    if (!this.buried || this.through) return centres;
    for (let i = 0; i < core; i++) if (this.buried[i] <= core) centres[3 * i + 2] = NOWHERE;
    return centres;
  }

  // Make the modules transparent and show the path of the chain, or reverse this.
  /** @param {boolean} on */
  seeThrough(on) {
    this.through = on;
    if (!this.open || !this.bundle) return;
    this.apply([
      ...this.nodesOfPieces.map((name) =>
        update(name, {
          opacity: on ? SEEN_THROUGH : null,
          cast_shadow: !on,
          receive_shadow: !on,
        }),
      ),
      visibility("/path", on),
    ]);
    if (this.latest) this.draw(...this.latest);
  }

  /** @param {Poses} poses */
  path({ positions }) {
    const n = positions.length / 3;
    const points = new Float32Array(6 * (n - 1));
    for (let i = 0; i < n - 1; i++)
      for (let k = 0; k < 6; k++) points[6 * i + k] = positions[3 * i + k] * this.pitch;
    return points;
  }

  /** @param {Snapshot} snapshot */
  middle({ positions, framed }) {
    const sum = [0, 0];
    for (let i = 0; i < framed; i++) {
      sum[0] += positions[3 * i];
      sum[1] += positions[3 * i + 1];
    }
    return [sum[0] / framed, sum[1] / framed];
  }

  // Return the poses of the studs on the free faces of the first and the last module.
  /** @param {Poses} poses */
  ends({ positions, wxyzs }) {
    const { ends } = /** @type {Bundle} */ (this.bundle).header;
    const n = positions.length / 3;
    const at = new Float32Array(6);
    const turn = new Float32Array(8);
    [0, n - 1].forEach((i, k) => {
      const q = quaternionOf(wxyzs, i);
      const way = turned(q, ends[k].at);
      for (let c = 0; c < 3; c++) at[3 * k + c] = (positions[3 * i + c] + way[c]) * this.pitch;
      turn.set(times(q, ends[k].wxyz), 4 * k);
    });
    return { batched_positions: at, batched_wxyzs: turn };
  }

  // Move the ground towards its height just below the
  // visible part of the chain. Return true while it moves.
  /**
   * @param {number} seconds
   * @param {Snapshot} snapshot
   */
  moveGround(seconds, snapshot) {
    if (this.table) return false;
    const low = floorUnder(snapshot) * this.pitch;
    if (this.ground === low) return false;
    this.ground = groundAfter(this.ground ?? low, low, seconds, this.pitch);
    return true;
  }
}

// Return the height of the ground some seconds later, on its way to `low`.
/**
 * @param {number} before
 * @param {number} low
 * @param {number} seconds
 * @param {number} pitch
 */
export const groundAfter = (before, low, seconds, pitch) =>
  Math.abs(before - low) < LEVEL * pitch
    ? low
    : low + (before - low) * Math.exp(-seconds / (low < before ? SINK_S : RISE_S));

// Return discs with areas in proportion to the contact
// forces under the modules, in units of the scene.
/**
 * @param {Numbers} pressed forces in module weights, NaN if unknown
 * @param {Numbers} positions
 * @param {number} height
 * @param {number} pitch
 */
export function discs(pressed, positions, height, pitch) {
  const n = pressed.length;
  const places = new Float32Array(3 * n);
  const scales = new Float32Array(n);
  let standing = 0;
  for (let i = 0; i < n; i++) {
    if (!(pressed[i] > LEAST)) {
      places[3 * i + 2] = NOWHERE;
      continue;
    }
    places[3 * i] = positions[3 * i] * pitch;
    places[3 * i + 1] = positions[3 * i + 1] * pitch;
    places[3 * i + 2] = (height + ABOVE + APART * standing++) * pitch;
    scales[i] = AREA * Math.sqrt(pressed[i]);
  }
  return { places, scales };
}
