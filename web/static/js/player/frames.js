// Rows of batches: what is told of one frame. Ordinary folds tell all angles, long ones those of a
// window; web/timeline/frame_batch.py and web/timeline/window_columns.py tell the columns.

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
