// Frames of a timeline: their rows in batches, where each is stored, and which are fetched next. Needs no page and
// no network.

// Rows: the values of one frame. Ordinary folds have all angles, long ones those of a window;
// web/timeline/frame_batch.py and web/timeline/window_columns.py define the columns.

/**
 * @param {Numbers} a
 * @param {Numbers} b
 * @param {number} share
 */
const mix = (a, b, share) => Float64Array.from(a, (v, k) => v + (b[k] - v) * share);

// The angle of a hinge in a row: what is before its window is folded, what is behind it straight.
/**
 * @param {Pick<Row, "first" | "last" | "angles" | "foldedRad">} row
 * @param {number} hinge
 */
export const angleIn = ({ first, last, angles, foldedRad }, hinge) => (hinge < first ? foldedRad[hinge] : hinge < last ? angles[hinge - first] : 0);

// From which hinge to before which two rows may differ.
/**
 * @param {Row} a
 * @param {Row} b
 */
export const differing = (a, b) => [Math.min(a.first, b.first), Math.max(a.last, b.last)];

// The row between two; orientations turn the short way.
/**
 * @param {Row} a
 * @param {Row} b
 * @param {number} share
 * @returns {Row}
 */
export function between(a, b, share) {
  const [first, last] = differing(a, b);
  const angles = Float64Array.from({ length: last - first }, (_, k) => {
    const one = angleIn(a, first + k);
    return one + (angleIn(b, first + k) - one) * share;
  });
  const same = Array.from(a.wxyz).reduce((sum, v, k) => sum + v * b.wxyz[k], 0) >= 0;
  const wxyz = mix(a.wxyz, same ? b.wxyz : Array.from(b.wxyz, (v) => -v), share);
  return { ...a, position: mix(a.position, b.position, share), wxyz, first, last, angles };
}

/** @param {object} arrays */
const bytesOf = (arrays) => Object.values(arrays).reduce((/** @type {number} */ sum, { byteLength }) => sum + byteLength, 0);

/**
 * @param {Floats} values
 * @param {number} k
 * @param {number} width
 */
const part = (values, k, width) => values.subarray(k * width, (k + 1) * width);

// All angles of each frame, as windows of the whole chain.
/**
 * @param {WholeArrays} arrays
 * @param {number} joints
 * @returns {WindowArrays}
 */
function asWindows({ root_position, root_wxyz, joint_angles_rad, joint_error_rad, ...kept }, joints) {
  const rows = kept.time_s.length;
  return {
    ...kept, base_position: root_position, base_wxyz: root_wxyz, angles: joint_angles_rad, errors_rad: joint_error_rad, steps: new Int32Array(),
    first: new Uint8Array(rows), counts: new Int32Array(rows).fill(joints), recorded: new Uint8Array(rows).fill(1),
  };
}

const STEP = 2 ** -20;

// Angles from the hinge `first` to before `last`; what is before is folded, what is behind straight.
export class Rows {
  /**
   * @param {Pick<Batch, "arrays">} batch
   * @param {Floats} foldedRad
   */
  constructor({ arrays }, foldedRad) {
    const { counts, steps, ...kept } = "first" in arrays ? arrays : asWindows(arrays, foldedRad.length);
    this.rows = arrays.time_s.length;
    this.foldedRad = foldedRad;
    this.noErrors = new Float32Array(foldedRad.length).fill(NaN);
    let end = 0;
    const ends = Uint32Array.from(counts, (count) => (end += count));
    this.arrays = { ...kept, ends, angles: kept.angles ?? this.unpack(kept.first, counts, steps) };
    this.bytes = bytesOf(this.arrays);
  }

  // Each angle was told as its difference from what the hinge had in the row before.
  /**
   * @param {Numbers} first
   * @param {Numbers} counts
   * @param {Int32Array} steps
   */
  unpack(first, counts, steps) {
    const angles = new Float32Array(steps.length);
    const folded = (/** @type {number} */ j) => Math.floor(Math.fround(this.foldedRad[j]) / STEP + 0.5);
    let at = 0;
    for (let k = 0; k < this.rows; k++) {
      const before = k ? at - counts[k - 1] - first[k - 1] : 0; // where hinge 0 would have been
      const [begin, end] = k ? [first[k - 1], first[k - 1] + counts[k - 1]] : [0, 0];
      for (let i = 0, j = first[k]; i < counts[k]; i++, j++, at++) {
        if (k) steps[at] += j < begin ? folded(j) : j < end ? steps[before + j] : 0;
        angles[at] = steps[at] * STEP;
      }
    }
    return angles;
  }

  /**
   * @param {number} k
   * @returns {Row}
   */
  row(k) {
    const { arrays, foldedRad } = this;
    const { angles, ends, first } = arrays;
    const begin = k ? ends[k - 1] : 0;
    return {
      time_s: arrays.time_s[k], phase: arrays.phase[k], position: part(arrays.base_position, k, 3), wxyz: part(arrays.base_wxyz, k, 4),
      first: first[k], last: first[k] + ends[k] - begin, angles: angles.subarray(begin, ends[k]), errors: this.errors(k, begin), foldedRad,
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
}

// Angles of windows backwards, then forwards: from those of a plan, the columns that a batch lacks.
/**
 * @param {import("../check/plan.js").Plan} plan
 * @returns {Pick<WindowArrays, "first" | "counts" | "steps" | "angles">}
 */
export function thereAndBack({ frames, first, last, offsets, values }) {
  const order = Array.from({ length: 2 * frames }, (_, k) => (k < frames ? frames - 1 - k : k - frames));
  const angles = new Float32Array(2 * values.length);
  let at = 0;
  for (const k of order) {
    angles.set(values.subarray(offsets[k], offsets[k + 1]), at);
    at += offsets[k + 1] - offsets[k];
  }
  return { first: Int32Array.from(order, (k) => first[k]), counts: Int32Array.from(order, (k) => last[k] - first[k]), steps: new Int32Array(), angles };
}

// Where frames are stored.

const MAX_BYTES = 384 * 2 ** 20;
const MAX_WINDOW_BYTES = 64 * 2 ** 20;
const BATCH_BYTES = 2 ** 20;
const MAX_BATCH_FRAMES = 128;
const WINDOW_FRAMES = 256;
const FEWEST_CHUNKS = 4; // that are stored in any case
const AHEAD = 6; // chunks of a long timeline that are fetched before they are needed
const BEHIND = 1;

export class FrameStore {
  total = 0; // frames of the timeline
  focus = 0; // frame around which frames are wanted
  /** @type {Map<number, { batch: Rows, k: number }>} the batch that has each frame, and the row there */
  frames = new Map();
  /** @type {Set<number>} chunks that are being fetched */
  loading = new Set();

  /**
   * @param {number} joints
   * @param {boolean} windowed whether only what is around the focus is fetched, of a long timeline
   */
  constructor(joints = 0, windowed = false) {
    this.windowed = windowed;
    this.rowBytes = 8 * joints + 40;
    this.rows = windowed ? WINDOW_FRAMES : Math.max(1, Math.min(MAX_BATCH_FRAMES, Math.floor(BATCH_BYTES / this.rowBytes))); // of a chunk
  }

  get last() { return Math.max(0, this.total - 1); }

  // Number of chunks of the timeline, and that at the focus.
  get count() { return Math.ceil(this.total / this.rows); }

  get here() { return this.indexOf(this.focus); }

  /** @param {number} frame */
  indexOf(frame) { return Math.floor(frame / this.rows); }

  // Stores the rows of a batch.
  /**
   * @param {Rows} batch
   * @param {Pick<BatchHeader, "start" | "stride">} header
   */
  put(batch, { start, stride }) {
    for (let k = 0; k < batch.rows; k++) this.frames.set(start + k * stride, { batch, k });
  }

  /**
   * @param {number} frame
   * @returns {Row | null}
   */
  row(frame) {
    const found = this.frames.get(frame);
    return found ? found.batch.row(found.k) : null;
  }

  // The nearest frame that is here.
  /** @param {number} frame */
  nearest(frame) {
    for (let away = 0; away <= this.last; away++) {
      for (const k of [frame - away, frame + away]) {
        if (k >= 0 && k <= this.last && this.frames.has(k)) return k;
      }
    }
    return null;
  }

  // The frames to fetch for a chunk: from the first that is missing on.
  /**
   * @param {number} index
   * @returns {{ from: number, to: number }}
   */
  missing(index) {
    const to = Math.min(this.total, (index + 1) * this.rows);
    let from = index * this.rows;
    while (from < to && this.frames.has(from)) from++;
    return { from, to };
  }

  /** @param {number} index */
  full(index) {
    const { from, to } = this.missing(index);
    return from >= to;
  }

  // The chunk to fetch next: those around the focus first; null when all that is wanted is here.
  /** @param {boolean} end whether the last frame of a long timeline is wanted as well */
  next(end) {
    for (const index of this.windowed ? this.near(end) : this.onward()) if (!this.full(index) && !this.loading.has(index)) return index;
    return null;
  }

  /** @param {boolean} end */
  *near(end) {
    const { here, count } = this;
    for (let away = 0; away <= AHEAD; away++) {
      if (here + away < count) yield here + away;
      if (away && away <= BEHIND && here >= away) yield here - away;
    }
    if (end && this.nearest(this.last) !== this.last) yield count - 1;
  }

  *onward() {
    const most = Math.max(FEWEST_CHUNKS, Math.floor(MAX_BYTES / (this.rows * this.rowBytes)));
    for (let away = 0; away < Math.min(this.count, most); away++) yield (this.here + away) % this.count;
  }

  // Lets go of what is farthest from the focus when there is too much.
  spare() {
    const { here, count, windowed } = this;
    const away = (/** @type {number} */ index) => (windowed ? Math.abs(index - here) : (index - here + count) % count);
    while (this.bytes > (windowed ? MAX_WINDOW_BYTES : MAX_BYTES)) {
      const chunks = new Set([...this.frames.keys()].map((frame) => this.indexOf(frame)));
      if (chunks.size <= FEWEST_CHUNKS) return;
      const farthest = [...chunks].reduce((a, b) => (away(a) > away(b) ? a : b));
      for (const frame of this.frames.keys()) if (this.indexOf(frame) === farthest) this.frames.delete(frame);
    }
  }

  get bytes() {
    const batches = new Set([...this.frames.values()].map(({ batch }) => batch));
    return [...batches].reduce((sum, { bytes }) => sum + bytes, 0);
  }
}
