// Frames: their rows in batches, how far the chain is folded, and the orientation in which it is shown.
import { quaternionOf, times } from "../lib/kinematics.js";

// Rows: the values of one frame. Ordinary folds have all angles, long ones those of a window;
// web/timeline/frame_batch.py and web/timeline/window_columns.py define the columns.

/**
 * @param {Numbers} a
 * @param {Numbers} b
 * @param {number} share
 */
const mix = (a, b, share) => Float64Array.from(a, (v, k) => v + (b[k] - v) * share);

// The pose of a module between two; orientations turn the short way.
/**
 * @param {Row} a
 * @param {Row} b
 * @param {number} share
 */
function poseBetween(a, b, share) {
  const same = Array.from(a.wxyz).reduce((sum, v, k) => sum + v * b.wxyz[k], 0) >= 0;
  return { position: mix(a.position, b.position, share), wxyz: mix(a.wxyz, same ? b.wxyz : Array.from(b.wxyz, (v) => -v), share) };
}

/** @param {object} arrays */
const bytesOf = (arrays) => Object.values(arrays).reduce((/** @type {number} */ sum, { byteLength }) => sum + byteLength, 0);

/**
 * @param {Floats} values
 * @param {number} k
 * @param {number} width
 */
const part = (values, k, width) => values.subarray(k * width, (k + 1) * width);

// All angles of each frame.
export class Whole {
  /**
   * @param {Pick<Message<BatchHeader, WholeArrays>, "arrays">} batch
   * @param {{ joints: number }} timeline
   */
  constructor({ arrays }, { joints }) {
    this.arrays = arrays;
    this.joints = joints;
    this.rows = arrays.time_s.length;
    this.bytes = bytesOf(arrays);
  }

  /**
   * @param {number} k
   * @returns {Row}
   */
  row(k) {
    const { arrays, joints } = this;
    return {
      time_s: arrays.time_s[k], phase: arrays.phase[k], position: part(arrays.root_position, k, 3), wxyz: part(arrays.root_wxyz, k, 4),
      angles: part(arrays.joint_angles_rad, k, joints), errors: part(arrays.joint_error_rad, k, joints),
    };
  }

  /**
   * @param {Row} a
   * @param {Row} b
   * @param {number} share
   * @returns {Row}
   */
  static between(a, b, share) { return { ...a, ...poseBetween(a, b, share), angles: mix(a.angles, b.angles, share) }; }

  /**
   * @param {import("../lib/kinematics.js").Kinematics} kinematics
   * @param {Row} row
   * @returns {WindowPoses}
   */
  static poses(kinematics, { angles, position, wxyz }) { return kinematics.poses(angles, position, wxyz); }

  /**
   * @param {Row} row
   * @param {number} j
   */
  static angle({ angles }, j) { return angles[j]; }
}

const STEP = 2 ** -20;

// Angles from the hinge `first` to before `last`; what is before is folded, what is behind straight.
export class Window {
  /**
   * @param {Pick<Message<BatchHeader, WindowArrays>, "arrays">} batch
   * @param {{ foldedRad: Floats, noErrors: Floats }} timeline
   */
  constructor({ arrays }, { foldedRad, noErrors }) {
    const { counts, steps, ...kept } = arrays;
    this.rows = arrays.time_s.length;
    this.foldedRad = foldedRad;
    this.noErrors = noErrors;
    this.arrays = { ...kept, ends: new Uint32Array(this.rows), angles: new Float32Array(steps.length) };
    this.unpack(counts, steps);
    this.bytes = bytesOf(this.arrays);
  }

  // Each angle was told as its difference from what the hinge had in the row before.
  /**
   * @param {Numbers} counts
   * @param {Int32Array} steps
   */
  unpack(counts, steps) {
    const { first, ends, angles } = this.arrays;
    const folded = (/** @type {number} */ j) => Math.floor(Math.fround(this.foldedRad[j]) / STEP + 0.5);
    let at = 0;
    for (let k = 0; k < this.rows; k++) {
      const before = k ? at - counts[k - 1] - first[k - 1] : 0; // where hinge 0 would have been
      const [begin, end] = k ? [first[k - 1], first[k - 1] + counts[k - 1]] : [0, 0];
      for (let i = 0, j = first[k]; i < counts[k]; i++, j++, at++) {
        if (k) steps[at] += j < begin ? folded(j) : j < end ? steps[before + j] : 0;
        angles[at] = steps[at] * STEP;
      }
      ends[k] = at;
    }
  }

  /**
   * @param {number} k
   * @returns {WindowRow}
   */
  row(k) {
    const { arrays, foldedRad } = this;
    const { angles, ends, first } = arrays;
    const begin = k ? ends[k - 1] : 0;
    const errors = this.errors(k, begin);
    return {
      time_s: arrays.time_s[k], phase: arrays.phase[k], position: part(arrays.base_position, k, 3), wxyz: part(arrays.base_wxyz, k, 4),
      first: first[k], last: first[k] + ends[k] - begin, angles: angles.subarray(begin, ends[k]), errors, foldedRad,
    };
  }

  // Of all hinges, of which those outside of the window are as they should be.
  /**
   * @param {number} k
   * @param {number} begin
   */
  errors(k, begin) {
    const { ends, first, errors_rad: told, recorded } = this.arrays;
    if (!told || !recorded?.[k]) return this.noErrors;
    const found = new Float32Array(this.foldedRad.length);
    found.set(told.subarray(begin, ends[k]), first[k]);
    return found;
  }

  /**
   * @param {WindowRow} a
   * @param {WindowRow} b
   * @param {number} share
   * @returns {WindowRow}
   */
  static between(a, b, share) {
    const first = Math.min(a.first, b.first);
    const last = Math.max(a.last, b.last);
    const angles = Float64Array.from({ length: last - first }, (_, k) => {
      const one = Window.angle(a, first + k);
      return one + (Window.angle(b, first + k) - one) * share;
    });
    return { ...a, ...poseBetween(a, b, share), first, last, angles };
  }

  /**
   * @param {import("../lib/kinematics.js").Kinematics} kinematics
   * @param {WindowRow} row
   * @returns {WindowPoses}
   */
  static poses(kinematics, row) { return kinematics.windowPoses(row, row.position, row.wxyz); }

  /**
   * @param {Pick<WindowRow, "first" | "last" | "angles" | "foldedRad">} row
   * @param {number} j
   */
  static angle({ first, last, angles, foldedRad }, j) { return j < first ? foldedRad[j] : j < last ? angles[j - first] : 0; }
}

// The measure of folding: 0 for the straight chain, 1 when all hinges have the angles of the shape. It is the
// mean over the hinges of angle / goal, each from 0 to 1 and weighted with |goal|. A plain sum of errors would
// stay at 0 while the chain bends everywhere on its way; this one rises steadily.
/**
 * @param {(hinge: number) => number} angle
 * @param {Floats} goal
 */
export function foldedness(angle, goal) {
  let reached = 0;
  let all = 0;
  for (let j = 0; j < goal.length; j++) {
    const wanted = Math.abs(goal[j]);
    all += wanted;
    if (wanted) reached += Math.min(wanted, Math.max(0, angle(j) * Math.sign(goal[j])));
  }
  return all > 0 ? reached / all : 1;
}

// The frame of the fold with that share of folding, between two where need be; found by halving, of the
// frames that are here.
/**
 * @param {import("./timeline.js").Timeline} timeline
 * @param {number} wanted
 */
export function frameFolded(timeline, wanted) {
  const folding = timeline.outline.phases.findLast(({ name }) => name === "playback");
  if (!folding) return null;
  const value = (/** @type {number} */ frame) => {
    const row = timeline.row(frame);
    return row && foldedness((j) => timeline.how.angle(row, j), timeline.foldedRad);
  };
  let [low, high] = [folding.from, folding.to - 1];
  if (wanted <= 0) return low;
  if (wanted >= 1) return high;
  let [less, more] = [value(low) ?? 0, value(high) ?? 1];
  while (high - low > 1) {
    const middle = hereBetween(timeline, low, high);
    if (middle === null) break;
    const found = value(middle) ?? 0;
    if (found < wanted) [low, less] = [middle, found];
    else [high, more] = [middle, found];
  }
  const share = more > less ? (wanted - less) / (more - less) : 1;
  return low + (high - low) * Math.min(1, Math.max(0, share));
}

// The frame that is here and nearest to the middle of two, without them.
/**
 * @param {import("./timeline.js").Timeline} timeline
 * @param {number} low
 * @param {number} high
 */
function hereBetween(timeline, low, high) {
  const middle = Math.floor((low + high) / 2);
  for (let away = 0; middle - away > low || middle + away < high; away++) {
    if (middle + away < high && timeline.row(middle + away)) return middle + away;
    if (middle - away > low && timeline.row(middle - away)) return middle - away;
  }
  return null;
}

/** Seconds in which the correction fades in when a timeline is completed on an open page. Chosen. */
const FADE_S = 0.8;
const MIN_SINE = 1e-9; // of half the angle of a correction; a smaller one is none

// The finished shape stands as it was drawn. A chain that floats turns as a whole while it folds, so the
// orientation at the end of a simulated fold is not that of the drawing. The playback is shown in a frame
// of reference that turns evenly: not at all at the straight chain, fully at the last frame. Only the
// orientation of the first or root module changes; hinge angles and files stay as recorded.
export class Standing {
  /** @type {{ angle: number, axis: Vector, from: number, to: number } | null} */
  correction = null;
  amount = 0; // of the correction that is shown, 0 to 1

  // Sets the correction from the orientations of one module at the last frame and in the drawing.
  /**
   * @param {Numbers} end
   * @param {Numbers} drawn
   * @param {Phase} folding
   * @param {boolean} fade
   */
  set(end, drawn, { from, to }, fade) {
    const length = Math.hypot(...Array.from(end)) * Math.hypot(...Array.from(drawn));
    const [w, x, y, z] = times(quaternionOf(drawn), [end[0], -end[1], -end[2], -end[3]], [0, 0, 0, 0]).map((v) => v / length);
    const sine = Math.hypot(x, y, z) * (w < 0 ? -1 : 1); // the short way
    this.correction = Math.abs(sine) < MIN_SINE ? null : { angle: 2 * Math.atan2(Math.abs(sine), Math.abs(w)), axis: [x / sine, y / sine, z / sine], from, to };
    if (!fade) this.amount = 1;
  }

  clear() {
    this.correction = null;
    this.amount = 0;
  }

  get fading() { return this.correction !== null && this.amount < 1; }

  // Lets seconds pass; true while the correction fades in.
  /** @param {number} passed */
  advance(passed) {
    if (!this.fading) return false;
    this.amount = Math.min(1, this.amount + passed / FADE_S);
    return true;
  }

  // The orientation that is shown in place of a recorded one at a frame.
  /**
   * @param {Floats} wxyz
   * @param {number} frame
   */
  turned(wxyz, frame) {
    const { correction, amount } = this;
    if (!correction || !amount || frame <= correction.from) return wxyz;
    const { angle, axis: [x, y, z], from, to } = correction;
    const half = (angle / 2) * amount * smooth(Math.min(1, (frame - from) / Math.max(1, to - 1 - from)));
    const s = Math.sin(half);
    return Float64Array.from(times([Math.cos(half), s * x, s * y, s * z], quaternionOf(wxyz), [0, 0, 0, 0]));
  }
}

/** @param {number} share */
const smooth = (share) => share * share * (3 - 2 * share);
