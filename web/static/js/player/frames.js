// Frames of a timeline: their rows in batches, their storage, and the order in which they are
// fetched. Needs no page and no network.

// A row holds the values of one frame. Rows of ordinary folds have all angles,
// those of long folds the angles of a window; web/timeline/frame_batch.py and
// web/timeline/window_columns.py define the columns.

/**
 * @param {Numbers} a
 * @param {Numbers} b
 * @param {number} share
 */
const mix = (a, b, share) => Float64Array.from(a, (v, k) => v + (b[k] - v) * share);

// Return the angle of a hinge in a row: hinges before
// the window are folded, those after it straight.
/**
 * @param {Pick<Row, "first" | "last" | "angles" | "foldedRad">} row
 * @param {number} hinge
 */
export const angleIn = ({ first, last, angles, foldedRad }, hinge) =>
  hinge < first ? foldedRad[hinge] : hinge < last ? angles[hinge - first] : 0;

// Return the half-open range of hinges in which two rows may differ.
/**
 * @param {Row} a
 * @param {Row} b
 */
export const differing = (a, b) => [Math.min(a.first, b.first), Math.max(a.last, b.last)];

// Interpolate between two rows; orientations turn the short way.
/**
 * @param {Row} a
 * @param {Row} b
 * @param {number} share
 * @returns {Row}
 */
export function between(a, b, share) {
  const [first, last] = differing(a, b);
  const angles = Float64Array.from({ length: last - first }, (_, k) => {
    const angle = angleIn(a, first + k);
    return angle + (angleIn(b, first + k) - angle) * share;
  });
  const aligned = Array.from(a.wxyz).reduce((sum, v, k) => sum + v * b.wxyz[k], 0) >= 0;
  const wxyz = mix(a.wxyz, aligned ? b.wxyz : Array.from(b.wxyz, (v) => -v), share);
  return { ...a, position: mix(a.position, b.position, share), wxyz, first, last, angles };
}

/** @param {object} arrays */
const bytesOf = (arrays) =>
  Object.values(arrays).reduce((/** @type {number} */ sum, { byteLength }) => sum + byteLength, 0);

/**
 * @param {Floats} values
 * @param {number} k
 * @param {number} width
 */
const part = (values, k, width) => values.subarray(k * width, (k + 1) * width);

// Convert frames with all angles to windows that span the whole chain.
/**
 * @param {WholeArrays} arrays
 * @param {number} joints
 * @returns {WindowArrays}
 */
function asWindows(
  { root_position, root_wxyz, joint_angles_rad, joint_error_rad, ...columns },
  joints,
) {
  const rows = columns.time_s.length;
  return {
    ...columns,
    base_position: root_position,
    base_wxyz: root_wxyz,
    angles: joint_angles_rad,
    errors_rad: joint_error_rad,
    steps: new Int32Array(),
    first: new Uint8Array(rows),
    counts: new Int32Array(rows).fill(joints),
    recorded: new Uint8Array(rows).fill(1),
  };
}

const STEP = 2 ** -20;

// Rows of a batch. The angles are those of hinges `first` to
// `last` − 1; earlier hinges are folded, later ones straight.
export class Rows {
  /**
   * @param {Pick<Batch, "arrays">} batch
   * @param {Floats} foldedRad
   */
  constructor({ arrays }, foldedRad) {
    const { counts, steps, ...columns } =
      "first" in arrays ? arrays : asWindows(arrays, foldedRad.length);
    this.rows = arrays.time_s.length;
    this.foldedRad = foldedRad;
    this.noErrors = new Float32Array(foldedRad.length).fill(NaN);
    let end = 0;
    const ends = Uint32Array.from(counts, (count) => (end += count));
    this.arrays = {
      ...columns,
      ends,
      angles: columns.angles ?? this.unpack(columns.first, counts, steps),
    };
    this.bytes = bytesOf(this.arrays);
  }

  // Decode angles that are stored as differences from the previous row.
  /**
   * @param {Numbers} first
   * @param {Numbers} counts
   * @param {Int32Array} steps
   */
  unpack(first, counts, steps) {
    const angles = new Float32Array(steps.length);
    const folded = (/** @type {number} */ j) =>
      Math.floor(Math.fround(this.foldedRad[j]) / STEP + 0.5);
    let at = 0;
    for (let k = 0; k < this.rows; k++) {
      // Offset of hinge 0 in the previous row.
      const before = k ? at - counts[k - 1] - first[k - 1] : 0;
      const [start, end] = k ? [first[k - 1], first[k - 1] + counts[k - 1]] : [0, 0];
      for (let i = 0, j = first[k]; i < counts[k]; i++, j++, at++) {
        if (k) steps[at] += j < start ? folded(j) : j < end ? steps[before + j] : 0;
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
    const start = k ? ends[k - 1] : 0;
    return {
      time_s: arrays.time_s[k],
      phase: arrays.phase[k],
      position: part(arrays.base_position, k, 3),
      wxyz: part(arrays.base_wxyz, k, 4),
      first: first[k],
      last: first[k] + ends[k] - start,
      angles: angles.subarray(start, ends[k]),
      errors: this.errors(k, start),
      foldedRad,
    };
  }

  // Return the errors of all hinges; those outside the window are zero by construction.
  /**
   * @param {number} k
   * @param {number} start
   */
  errors(k, start) {
    const { ends, first, errors_rad: errors, recorded } = this.arrays;
    if (!errors || !recorded?.[k]) return this.noErrors;
    const jointErrors = new Float32Array(this.foldedRad.length);
    jointErrors.set(errors.subarray(start, ends[k]), first[k]);
    return jointErrors;
  }
}

// Return the windows of a plan backwards, then forwards: the columns that a compact batch omits.
/**
 * @param {import("../check/plan.js").Plan} plan
 * @returns {Pick<WindowArrays, "first" | "counts" | "steps" | "angles">}
 */
export function thereAndBack({ frames, first, last, offsets, values }) {
  const order = Array.from({ length: 2 * frames }, (_, k) =>
    k < frames ? frames - 1 - k : k - frames,
  );
  const angles = new Float32Array(2 * values.length);
  let at = 0;
  for (const k of order) {
    angles.set(values.subarray(offsets[k], offsets[k + 1]), at);
    at += offsets[k + 1] - offsets[k];
  }
  return {
    first: Int32Array.from(order, (k) => first[k]),
    counts: Int32Array.from(order, (k) => last[k] - first[k]),
    steps: new Int32Array(),
    angles,
  };
}

// Storage of frames.

const MAX_BYTES = 384 * 2 ** 20;
const MAX_WINDOW_BYTES = 64 * 2 ** 20;
const BATCH_BYTES = 2 ** 20;
const MAX_BATCH_FRAMES = 128;
const WINDOW_FRAMES = 256;
const FEWEST_CHUNKS = 4; // stored in any case
const AHEAD = 6; // chunks of a long timeline to fetch ahead of the playhead
const BEHIND = 1;

export class FrameStore {
  total = 0; // frames of the timeline
  focus = 0; // frame around which frames are fetched
  /** @type {Map<number, { batch: Rows, k: number }>} batch and row of each frame */
  frames = new Map();
  /** @type {Set<number>} chunks in flight */
  loading = new Set();

  /**
   * @param {number} joints
   * @param {boolean} windowed true for a long timeline, of which only the frames around the focus
   *   are fetched
   */
  constructor(joints = 0, windowed = false) {
    this.windowed = windowed;
    this.rowBytes = 8 * joints + 40;
    this.rows = windowed
      ? WINDOW_FRAMES
      : // Of a chunk.
        Math.max(1, Math.min(MAX_BATCH_FRAMES, Math.floor(BATCH_BYTES / this.rowBytes)));
  }

  get last() {
    return Math.max(0, this.total - 1);
  }

  // Number of chunks of the timeline.
  get count() {
    return Math.ceil(this.total / this.rows);
  }

  // Index of the chunk at the focus.
  get focusChunk() {
    return this.indexOf(this.focus);
  }

  /** @param {number} frame */
  indexOf(frame) {
    return Math.floor(frame / this.rows);
  }

  // Store the rows of a batch.
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
    const location = this.frames.get(frame);
    return location ? location.batch.row(location.k) : null;
  }

  // Return the nearest loaded frame.
  /** @param {number} frame */
  nearest(frame) {
    for (let distance = 0; distance <= this.last; distance++) {
      for (const k of [frame - distance, frame + distance]) {
        if (k >= 0 && k <= this.last && this.frames.has(k)) return k;
      }
    }
    return null;
  }

  // Return the frames to fetch for a chunk, from its first missing frame on.
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

  // Return the next chunk to fetch, nearest to the focus; null if all required chunks are loaded.
  /** @param {boolean} end true if the last frame of a long timeline is required, too */
  next(end) {
    for (const index of this.windowed ? this.near(end) : this.onward())
      if (!this.full(index) && !this.loading.has(index)) return index;
    return null;
  }

  /** @param {boolean} end */
  *near(end) {
    const { focusChunk, count } = this;
    for (let distance = 0; distance <= AHEAD; distance++) {
      if (focusChunk + distance < count) yield focusChunk + distance;
      if (distance && distance <= BEHIND && focusChunk >= distance) yield focusChunk - distance;
    }
    if (end && this.nearest(this.last) !== this.last) yield count - 1;
  }

  *onward() {
    const maxChunks = Math.max(FEWEST_CHUNKS, Math.floor(MAX_BYTES / (this.rows * this.rowBytes)));
    for (let distance = 0; distance < Math.min(this.count, maxChunks); distance++)
      yield (this.focusChunk + distance) % this.count;
  }

  // Drop the chunks that are farthest from the focus while memory use exceeds the limit.
  spare() {
    const { focusChunk, count, windowed } = this;
    const distanceTo = (/** @type {number} */ index) =>
      windowed ? Math.abs(index - focusChunk) : (index - focusChunk + count) % count;
    while (this.bytes > (windowed ? MAX_WINDOW_BYTES : MAX_BYTES)) {
      const chunks = new Set([...this.frames.keys()].map((frame) => this.indexOf(frame)));
      if (chunks.size <= FEWEST_CHUNKS) return;
      const farthest = [...chunks].reduce((a, b) => (distanceTo(a) > distanceTo(b) ? a : b));
      for (const frame of this.frames.keys())
        if (this.indexOf(frame) === farthest) this.frames.delete(frame);
    }
  }

  get bytes() {
    const batches = new Set([...this.frames.values()].map(({ batch }) => batch));
    return [...batches].reduce((sum, { bytes }) => sum + bytes, 0);
  }
}
