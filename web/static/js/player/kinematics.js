// Forward kinematics from hinge angles and a root pose, the progress of folding, and the displayed
// orientation. The poses, as in planner/chain/module.py:
// T[i+1] = T[i] · Trans(anchor) · Rot(axis_1, q_1) … Rot(axis_K, q_K) · turn · Trans(offset),
// with row kinds[i % kinds.length] of the chain's joints.
import { angleIn } from "./frames.js";
import { quaternionOf, times, turned } from "../viewer/camera.js";

const vectorOf = (/** @type {Numbers} */ p, i = 0) =>
  /** @type {Vector} */ ([p[3 * i], p[3 * i + 1], p[3 * i + 2]]);
/**
 * @param {Quaternion} turn
 * @returns {Quaternion}
 */
const conjugate = ([w, x, y, z]) => [w, -x, -y, -z];
/**
 * @param {Vector} axis
 * @param {number} angle
 * @returns {Quaternion}
 */
const rotation = ([x, y, z], angle) => {
  const s = Math.sin(angle / 2);
  return [Math.cos(angle / 2), s * x, s * y, s * z];
};

export class Kinematics {
  /** @type {Poses | undefined} */
  relativeFolded;
  /** @type {Poses | undefined} */
  relativeStraight;

  // `chain` as in the scene bundle's header; poses of windows need `foldedRad`.
  /**
   * @param {Chain} chain
   * @param {Floats | null} foldedRad
   */
  constructor(chain, foldedRad = null) {
    this.foldedRad = foldedRad;
    /** @type {Poses & { key: string } | null} */
    this.resting = null;
    this.chain = chain;
  }

  // Return the rotation across the joint of a link; `angle` returns the angle of a hinge.
  /**
   * @param {(hinge: number) => number} angle
   * @param {number} link
   */
  step(angle, link) {
    const { rigid_links: rigid, hinges, kinds, axes, turn } = this.chain;
    const row = kinds[link % kinds.length];
    /** @type {Quaternion} */
    let q = [1, 0, 0, 0];
    for (let k = 0, j = (link - rigid) * hinges; j >= 0 && k < hinges; k++, j++)
      q = times(q, rotation(axes[row][k], angle(j)));
    return times(q, turn[row]);
  }

  // Return centres (3n) and orientations (4n) of one configuration.
  /**
   * @param {Numbers} angles
   * @param {Numbers} position
   * @param {Numbers} wxyz
   * @returns {Poses}
   */
  poses(angles, position, wxyz) {
    const poses = this.room(Float32Array);
    moved(
      this.relative((j) => angles[j]),
      this.chain.root,
      [0, this.chain.modules],
      vectorOf(position),
      quaternionOf(wxyz),
      poses,
    );
    return poses;
  }

  // Return the poses of a chain that is folded before the hinge `first` and straight from `last`
  // on, given the `angles` of the hinges in between and the pose of module 0. The folded core and
  // the straight tail are rigid, so that only the window is computed joint by joint. The core ends
  // before module `core`; the tail begins with module `rod`.
  /** @param {Row} row */
  windowPoses(row) {
    const { modules: n, rigid_links: rigid, hinges } = this.chain;
    const poses = this.room(Float32Array);
    const core = Math.min(n, rigid + Math.floor(row.first / hinges) + 1);
    const rod = Math.min(n - 1, Math.max(core - 1, rigid + Math.ceil(row.last / hinges)));
    const folded = this.rested(row.position, row.wxyz);
    poses.positions.set(folded.positions.subarray(0, 3 * core));
    poses.wxyzs.set(folded.wxyzs.subarray(0, 4 * core));
    const [p, q] = this.ahead(
      (j) => angleIn(row, j),
      core - 1,
      rod + 1,
      vectorOf(folded.positions, core - 1),
      quaternionOf(folded.wxyzs, core - 1),
      poses,
    );
    moved(this.straight, rod, [rod, n], p, q, poses);
    return { ...poses, core, rod };
  }

  // Compute the poses of modules `start` to `end` − 1. Return the last one.
  /**
   * @param {(hinge: number) => number} angle
   * @param {number} start
   * @param {number} end
   * @param {Numbers} position
   * @param {Numbers} wxyz
   * @param {Poses} poses
   * @returns {[Vector, Quaternion]}
   */
  ahead(angle, start, end, position, wxyz, poses) {
    const { kinds, anchor, offset } = this.chain;
    const p = vectorOf(position);
    let q = quaternionOf(wxyz);
    put(start, p, q, poses);
    for (let i = start + 1; i < end; i++) {
      const row = kinds[(i - 1) % kinds.length];
      const a = turned(q, anchor[row]);
      q = times(q, this.step(angle, i - 1));
      const b = turned(q, offset[row]);
      for (let k = 0; k < 3; k++) p[k] += a[k] + b[k];
      put(i, p, q, poses);
    }
    return [p, q];
  }

  // Return the folded chain with its first module at this pose; cached until the pose changes.
  /**
   * @param {Numbers} position
   * @param {Numbers} wxyz
   * @returns {Poses}
   */
  rested(position, wxyz) {
    const key = [...Array.from(position), ...Array.from(wxyz)].join();
    if (this.resting?.key !== key) {
      const length = Math.hypot(...Array.from(wxyz));
      this.resting = { key, ...this.room(Float64Array) };
      moved(
        this.folded,
        0,
        [0, this.chain.modules],
        vectorOf(position),
        quaternionOf(Array.from(wxyz, (v) => v / length)),
        this.resting,
      );
    }
    return this.resting;
  }

  // Poses of the folded and of the straight chain relative to the first module.
  get folded() {
    const foldedRad = /** @type {Floats} */ (this.foldedRad);
    return (this.relativeFolded ??= this.relative((j) => foldedRad[j]));
  }

  get straight() {
    return (this.relativeStraight ??= this.relative(() => 0));
  }

  // Return poses relative to the first module.
  /** @param {(hinge: number) => number} angle */
  relative(angle) {
    const poses = this.room(Float64Array);
    this.ahead(angle, 0, this.chain.modules, [0, 0, 0], [1, 0, 0, 0], poses);
    return poses;
  }

  /**
   * @param {Float32ArrayConstructor | Float64ArrayConstructor} Type
   * @returns {Poses}
   */
  room(Type) {
    return { positions: new Type(3 * this.chain.modules), wxyzs: new Type(4 * this.chain.modules) };
  }
}

// Store one pose, with its quaternion normalised.
/**
 * @param {number} i
 * @param {Vector} p
 * @param {Quaternion} q
 * @param {Poses} found
 */
function put(i, p, q, { positions, wxyzs }) {
  const l = Math.hypot(q[0], q[1], q[2], q[3]);
  for (let k = 0; k < 3; k++) positions[3 * i + k] = p[k];
  for (let k = 0; k < 4; k++) wxyzs[4 * i + k] = q[k] /= l;
}

// Store the poses of modules `start` to `end` − 1 of a rigid chain
// in the shape of `shape`, where module `reference` has the pose p, q.
/**
 * @param {Poses} shape
 * @param {number} reference
 * @param {[start: number, end: number]} span
 * @param {Vector} p
 * @param {Quaternion} q
 * @param {Poses} poses
 */
function moved({ positions: from, wxyzs: turns }, reference, [start, end], p, q, poses) {
  const turn = times(q, conjugate(quaternionOf(turns, reference)));
  const [u, v, o] = vectorOf(from, reference);
  for (let i = start; i < end; i++) {
    const off = turned(turn, [from[3 * i] - u, from[3 * i + 1] - v, from[3 * i + 2] - o]);
    put(
      i,
      [p[0] + off[0], p[1] + off[1], p[2] + off[2]],
      times(turn, quaternionOf(turns, i)),
      poses,
    );
  }
}

// Return a moment with a module in its given pose, and all others moved with it; the moment itself
// without one.
/**
 * @template {Poses} Moment
 * @param {Moment} moment
 * @param {HeldModule | null} [heldModule]
 * @returns {Moment}
 */
export function heldStill(moment, heldModule) {
  if (!heldModule) return moment;
  const n = moment.positions.length / 3;
  const placed = { positions: new Float32Array(3 * n), wxyzs: new Float32Array(4 * n) };
  moved(moment, heldModule.module, [0, n], heldModule.position, heldModule.wxyz, placed);
  return { ...moment, ...placed };
}

// Centres of faces are compared on a grid.
const CELLS_PER_PITCH = 4;
const MAX_CELL = 2 ** 16; // from the origin, in both directions

// Return, for each module of the folded chain and each face of `sketch`,
// the module that touches and hides the face; `modules` if there is
// none. `sketch` and `shown_size` as in the scene bundle's header; the modules have one part.
/**
 * @param {Pick<BundleHeader, "sketch" | "shown_size">} header
 * @param {Poses} folded
 */
export function touching({ sketch, shown_size: size }, { positions, wxyzs }) {
  const { modules: n, parts } = sketch;
  const [{ corners, faces }] = parts;
  const middles = faces.map((face) =>
    [0, 1, 2].map((c) => face.reduce((sum, v) => sum + corners[v][c], 0) / face.length / size),
  );
  const neighbours = new Int32Array(n * faces.length).fill(n);
  const faceAt = new Map();
  for (let i = 0; i < n; i++) {
    const turn = quaternionOf(wxyzs, i);
    middles.forEach((middle, f) => {
      const key = turned(turn, vectorOf(middle)).reduce(
        (sum, v, c) =>
          sum * 2 * MAX_CELL + Math.round(CELLS_PER_PITCH * (positions[3 * i + c] + v)) + MAX_CELL,
        0,
      );
      const touchingFace = faceAt.get(key);
      if (touchingFace === undefined) {
        faceAt.set(key, i * faces.length + f);
        return;
      }
      neighbours[i * faces.length + f] = Math.floor(touchingFace / faces.length);
      neighbours[touchingFace] = i;
    });
  }
  return neighbours;
}

// Return, for each module, the number of folded modules from which on all its faces are hidden.
/**
 * @param {Int32Array} neighbours
 * @param {number} modules
 */
export function buriedBy(neighbours, modules) {
  const faces = neighbours.length / modules;
  return Int32Array.from(
    { length: modules },
    (_, i) => Math.max(i, ...neighbours.subarray(i * faces, (i + 1) * faces)) + 1,
  );
}

// Return the progress of folding: 0 for the straight chain, 1 if all hinges
// have the angles of the shape. It is the mean over the hinges of angle /
// goal, each from 0 to 1 and weighted with |goal|. A plain sum of errors would
// stay at 0 while the chain bends everywhere; this measure rises steadily.
/**
 * @param {(hinge: number) => number} angle
 * @param {Floats} goal
 */
export function foldedness(angle, goal) {
  let reached = 0;
  let all = 0;
  for (let j = 0; j < goal.length; j++) {
    const goalRad = Math.abs(goal[j]);
    all += goalRad;
    if (goalRad) reached += Math.min(goalRad, Math.max(0, angle(j) * Math.sign(goal[j])));
  }
  return all > 0 ? reached / all : 1;
}

// Return the fractional playback frame with this progress
// of folding, by bisection over the loaded frames.
/**
 * @param {import("./timeline.js").Timeline} timeline
 * @param {number} targetShare
 */
export function frameFolded(timeline, targetShare) {
  const folding = timeline.outline.phases.findLast(({ name }) => name === "playback");
  if (!folding) return null;
  const value = (/** @type {number} */ frame) => {
    const row = timeline.row(frame);
    return row && foldedness((j) => angleIn(row, j), timeline.foldedRad);
  };
  let [low, high] = [folding.from, folding.to - 1];
  if (targetShare <= 0) return low;
  if (targetShare >= 1) return high;
  let [lowValue, highValue] = [value(low) ?? 0, value(high) ?? 1];
  while (high - low > 1) {
    const middle = timeline.nearest(Math.ceil((low + high) / 2));
    if (middle === null || middle <= low || middle >= high) break; // no loaded frame in between
    const folded = value(middle) ?? 0;
    if (folded < targetShare) [low, lowValue] = [middle, folded];
    else [high, highValue] = [middle, folded];
  }
  const share = highValue > lowValue ? (targetShare - lowValue) / (highValue - lowValue) : 1;
  return low + (high - low) * Math.min(1, Math.max(0, share));
}

/** Duration of the fade-in of the correction when a timeline is completed on an open page. */
const FADE_S = 0.8;
const MIN_SINE = 1e-9; // of half the angle of a correction; smaller corrections are ignored

// Shows the finished shape in the orientation of its drawing. A floating chain rotates
// as a whole while it folds, so that a simulated fold ends in another orientation. The
// playback is therefore shown in a reference frame that rotates smoothly: not at all
// at the straight chain, fully at the last frame. Only the orientation of the first or
// root module changes; hinge angles and files stay as recorded.
export class Standing {
  /** @type {{ angle: number, axis: Vector, from: number, to: number } | null} */
  correction = null;
  amount = 0; // applied fraction of the correction, 0 to 1

  // Set the correction from the orientations of one module at the last frame and in the drawing.
  /**
   * @param {Numbers} end
   * @param {Numbers} drawn
   * @param {Phase} folding
   * @param {boolean} fade
   */
  set(end, drawn, { from, to }, fade) {
    const length = Math.hypot(...Array.from(end)) * Math.hypot(...Array.from(drawn));
    const [w, x, y, z] = times(quaternionOf(drawn), conjugate(quaternionOf(end))).map(
      (v) => v / length,
    );
    const sine = Math.hypot(x, y, z) * (w < 0 ? -1 : 1); // the short way
    this.correction =
      Math.abs(sine) < MIN_SINE
        ? null
        : {
            angle: 2 * Math.atan2(Math.abs(sine), Math.abs(w)),
            axis: [x / sine, y / sine, z / sine],
            from,
            to,
          };
    if (!fade) this.amount = 1;
  }

  clear() {
    this.correction = null;
    this.amount = 0;
  }

  get fading() {
    return this.correction !== null && this.amount < 1;
  }

  // Advance the fade-in by some seconds. Return true while it lasts.
  /** @param {number} passed */
  advance(passed) {
    if (!this.fading) return false;
    this.amount = Math.min(1, this.amount + passed / FADE_S);
    return true;
  }

  // Return the displayed orientation for a recorded one at a frame.
  /**
   * @param {Floats} wxyz
   * @param {number} frame
   */
  turned(wxyz, frame) {
    const { correction, amount } = this;
    if (!correction || !amount || frame <= correction.from) return wxyz;
    const { angle, axis, from, to } = correction;
    const share = Math.min(1, (frame - from) / Math.max(1, to - 1 - from));
    return Float64Array.from(
      times(rotation(axis, angle * amount * share * share * (3 - 2 * share)), quaternionOf(wxyz)),
    );
  }
}
