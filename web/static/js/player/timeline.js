// A fold's frames as they come in: where they are kept, which are fetched next, and the poses of a
// moment. What has been fetched once is scrubbed without a word to the server.
import { decode } from "../lib/columns.js";
import { Standing, Whole, Window, foldedness } from "./frames.js";
import { Kinematics, touching } from "../lib/kinematics.js";
import { Emitter } from "../lib/text.js";

const AT_ONCE = 2; // requests
const COARSE = 64; // frames that are fetched first, spread over the whole timeline
const BATCH_BYTES = 2 ** 20;
const LONGEST_BATCH = 128;
const MOST_BYTES = 384 * 2 ** 20;
const WINDOW_ROWS = 256;
const MOST_WINDOW_BYTES = 64 * 2 ** 20;
const AHEAD = 6; // chunks of a long timeline that are fetched before they are asked for
const BEHIND = 1;
const RETRY_MS = 300;
/** Pause before the next look for the first frames of a fold that has just begun. A larger value delays the first motion. Chosen. */
const QUICK_RETRY_MS = 50;
/** Number of those looks, after which the fold is taken to wait in the queue. A larger value costs requests. Chosen. */
const MAX_QUICK_TRIES = 40;
const LOOK_MS = 1000;
const MOST_LOOKS = 1800; // half an hour
const WAIT_S = 1;
const DAMAGED = 500; // the service says so of stored data that is not what was written

const BUSY = 429; // too many requests of this visitor wait

class DamagedError extends Error {}

// The service did not answer; it may after a pause.
class RefusedError extends Error {
  /** @param {Response} answer */
  constructor(answer) {
    super(`The server answered ${answer.status}.`);
    const retryS = answer.status === BUSY ? Number(answer.headers.get("Retry-After")) : 0;
    this.pauseMs = retryS > 0 ? 1000 * retryS : 4 * RETRY_MS;
  }
}

// Scene bundle and batches under an address of this server.
export class Source {
  /** @param {string} under */
  constructor(under) { this.under = under; }

  /** @returns {Promise<Bundle | null>} */
  bundle() { return this.get("bundle"); }

  /**
   * @param {BatchAsked} asked
   * @returns {Promise<Batch | null>}
   */
  batch({ from = 0, to = null, stride = 1, wait = 0 } = {}) {
    const asked = new URLSearchParams({ from: String(from), stride: String(stride), wait: String(wait) });
    if (to !== null) asked.set("to", String(to));
    return this.get(`batch?${asked}`);
  }

  // What a browser can take apart, or null while there is nothing.
  /**
   * @template {Message<object, object>} Told
   * @param {string} what
   * @returns {Promise<Told | null>}
   */
  async get(what) {
    const answer = await fetch(`${this.under}/${what}`);
    if (answer.status === 204) return null;
    if (answer.status === DAMAGED) throw new DamagedError((await answer.json()).detail);
    if (!answer.ok) throw new RefusedError(answer);
    return /** @type {Promise<Told>} */ (/** @type {unknown} */ (decode(await answer.arrayBuffer())));
  }
}

// A whole timeline in one batch, which is fetched once.
export class Recording extends Source {
  /** @type {Promise<Batch | null> | undefined} */
  once;

  batch() { return this.once ??= this.get("batch"); }
}

/** @typedef {Whole | Window} Rows */
/** @typedef {{ count: number, batches: (Rows | null)[], at: Uint32Array }} Chunk where each frame of a stretch is */

// Rows of either kind.
/**
 * @typedef {object} Kind
 * @property {(a: Row, b: Row, share: number) => Row} between
 * @property {(kinematics: Kinematics, row: Row) => WindowPoses} poses
 * @property {(row: Row, hinge: number) => number} angle
 */

export class Timeline extends Emitter {
  // Null until the timeline has begun: chain and outline; the others are not there before.
  /** @type {Chain & Hull} */
  chain;
  /** @type {TimelineOutline} */
  outline;
  /** @type {Bundle} */
  bundle;
  /** @type {Kinematics} */
  kinematics;
  /** @type {typeof Whole | typeof Window} */
  kind;
  /** @type {number} */
  joints;
  /** @type {number} */
  rows;
  /** @type {Floats} */
  foldedRad;
  /** @type {Floats | null} angles at the first frame */
  startRad = null;
  standing = new Standing();
  /** @type {Floats} */
  foldedPositions;
  /** @type {Float32Array<ArrayBuffer>} */
  noErrors;
  /** @type {number | undefined} */
  sharedScale;
  /** @type {string | null} */
  id;
  /** @type {number} */
  total;
  /** @type {BatchHeader["status"]} */
  status;
  /** @type {Map<number, Chunk>} */
  chunks;
  /** @type {Set<number>} */
  loading;
  /** @type {number} */
  focus;
  /** @type {number} */
  version;


  // `over` says that nothing more comes: the fold is over, whatever its timeline says.
  /**
   * @param {TimelineSource} source
   * @param {{ over?: boolean }} how
   */
  constructor(source, { over = true } = {}) {
    super();
    this.source = source;
    this.over = over;
    this.unsure = !over;
    /** @type {{ id: string, bundle: Promise<Bundle | null> } | null} */
    this.early = null; // the bundle of a timeline that has no frames yet
    this.looks = 0;
    this.tries = 0;
    this.grown = false; // on this page
    this.ended = false;
    this.running = false;
    this.forget();
    this.run();
  }

  forget() {
    this.id = null;
    this.chain = /** @type {never} */ (null);
    this.total = 0;
    this.status = "growing";
    this.outline = /** @type {never} */ (null);
    this.chunks = new Map();
    this.loading = new Set();
    this.focus = 0;
    this.version = 0;
    this.startRad = null;
    this.standing.clear();
  }

  get growing() { return this.status === "growing" && !this.over; }

  // The joint error at which a module is fully red; timelines beside each other share one.
  get errorScale() { return Math.max(this.outline.error_scale_rad, this.sharedScale ?? 0); }

  get last() { return Math.max(0, this.total - 1); }

  stop() { this.ended = true; }

  // The fold is over: what is here is looked at once more.
  finish() {
    this.over = true;
    this.run();
  }

  async run() {
    if (this.running) return;
    this.running = true;
    while (!this.ended) {
      try {
        if (!this.chain) await this.begin();
        else if (this.growing) await this.grow();
        else if (this.unsure && this.looks < MOST_LOOKS) await this.look();
        else break;
      } catch (error) {
        if (error instanceof DamagedError) this.damaged(error.message);
        else await pauseAfter(error); // what is here stays
      }
    }
    this.running = false;
    if (this.over && !this.ended) this.tell("settled");
  }

  // While a fold goes on, a timeline that is complete may yet be begun anew: its plan was refused.
  async look() {
    if (!this.over) await pause(LOOK_MS);
    this.looks++;
    const { id, over } = this;
    const batch = await this.source.batch({ from: this.total });
    if (id !== this.id) return;
    if (!batch || batch.header.id !== id) { this.begunAnew(); return; }
    const before = [this.total, this.status];
    this.take(batch);
    if (over) this.unsure = false;
    if (this.total !== before[0] || this.status !== before[1]) this.tell("grew");
    this.load();
  }

  // No motion is shown any more; the page says why.
  /** @param {string} detail */
  damaged(detail) {
    this.stop();
    this.forget();
    this.tell("damaged", detail);
  }

  begunAnew() {
    this.forget();
    this.tell("waiting");
    this.run();
  }

  async begin() {
    // A fold that has just begun is asked for frames alone until there are some.
    const waited = this.tries ? await this.source.batch({ to: 1 }) : null;
    const none = this.tries && !waited?.header.total;
    if (waited && none && this.early?.id !== waited.header.id) {
      this.early = { id: waited.header.id, bundle: this.source.bundle().catch(() => null) };
    }
    const early = this.early?.id === waited?.header.id ? await this.early?.bundle : null;
    const [bundle, first] = none ? [null, null] : await Promise.all([early ?? this.source.bundle(), waited ?? this.source.batch({ to: 1 })]);
    if (!bundle || !first || !first.header.total) {
      this.tell("waiting");
      await pause(this.tries++ < MAX_QUICK_TRIES ? QUICK_RETRY_MS : RETRY_MS);
      return;
    }
    // Frames spread over the whole timeline up to its last, so that it can be scrubbed everywhere at once.
    const stride = Math.ceil(first.header.total / COARSE);
    const from = (first.header.total - 1) % stride;
    const windowed = "first" in first.arrays;
    const spread = stride > 1 && (windowed || first.header.status !== "growing") ? await this.source.batch({ from, stride }) : null;
    const { header, arrays } = bundle;
    this.bundle = bundle;
    this.chain = header.chain;
    this.joints = arrays.folded_rad.length;
    this.foldedRad = arrays.folded_rad;
    this.foldedPositions = arrays.folded_positions;
    this.kinematics = new Kinematics(header.chain, this.foldedRad);
    this.kind = windowed ? Window : Whole;
    if (windowed) bundle.neighbours = touching(header, this.kinematics.folded);
    this.noErrors = new Float32Array(windowed ? this.joints : 0).fill(NaN);
    this.rows = windowed ? WINDOW_ROWS : Math.max(1, Math.min(LONGEST_BATCH, Math.floor(BATCH_BYTES / (8 * this.joints + 40))));
    this.id = first.header.id;
    this.take(first);
    const start = this.row(0);
    if (start) this.startRad = Float32Array.from({ length: this.joints }, (_, j) => this.how.angle(start, j));
    if (spread?.header.id === this.id) this.take(spread);
    this.tell("begun");
    this.load();
  }

  async grow() {
    this.grown = true;
    const batch = await this.source.batch({ from: this.total, wait: WAIT_S });
    if (!batch || batch.header.id !== this.id) { this.begunAnew(); return; }
    const before = [this.total, this.status];
    this.take(batch);
    if (this.total !== before[0] || this.status !== before[1]) this.tell("grew");
    this.load();
  }

  // What rows of this timeline can do.
  get how() { return /** @type {Kind} */ (/** @type {unknown} */ (this.kind)); }

  // A long timeline, of which only what is around the playhead is fetched.
  get windowed() { return this.kind === Window; }

  // Keeps what a batch brings.
  /** @param {Batch} batch */
  take(batch) {
    const { header } = batch;
    const found = this.windowed ? new Window(/** @type {Message<BatchHeader, WindowArrays>} */ (batch), this)
      : new Whole(/** @type {Message<BatchHeader, WholeArrays>} */ (batch), this);
    for (let row = 0, frame = header.start; row < found.rows; row++, frame += header.stride) {
      const chunk = this.chunk(Math.floor(frame / this.rows));
      const k = frame % this.rows;
      if (!chunk.batches[k]) chunk.count++;
      chunk.batches[k] = found;
      chunk.at[k] = row;
    }
    // A timeline that grows may have more than this batch; what is missing is asked for next.
    this.total = this.growing && header.status === "growing" && !this.windowed ? Math.max(this.total, header.stop) : header.total;
    this.status = header.status;
    this.outline = header.outline;
    this.version++;
    this.stand();
    this.spare();
  }

  // Turns the fold so that its last frame, once that is here, has the drawing's orientation.
  stand() {
    const { standing, outline, bundle: { header }, windowed } = this;
    if (this.growing) { standing.clear(); return; }
    const folding = outline.phases?.findLast(({ name }) => name === "playback");
    const end = folding && !header.table && !standing.correction ? this.row(this.last) : null;
    if (!end || !folding || !header.chain.folded_wxyz) return;
    standing.set(end.wxyz, windowed ? header.chain.folded_wxyz : header.chain.folded_root_wxyz, folding, this.grown);
  }

  // Where each frame of a stretch is kept: in a row of a batch.
  /** @param {number} index */
  chunk(index) {
    let chunk = this.chunks.get(index);
    if (!chunk) {
      chunk = { count: 0, batches: Array.from({ length: this.rows }, () => null), at: new Uint32Array(this.rows) };
      this.chunks.set(index, chunk);
    }
    return chunk;
  }

  /** @param {number} index */
  full(index) {
    const chunk = this.chunks.get(index);
    return chunk !== undefined && chunk.count >= Math.min(this.rows, this.total - index * this.rows);
  }

  // Whether all that is wanted is here.
  get complete() { return this.chain !== null && !this.growing && !this.loading.size && this.next() === null; }

  // The chunk to fetch next: those around the playhead first; null when all that is wanted is here.
  next() {
    const chunks = Math.ceil(this.total / this.rows);
    const here = Math.floor(this.focus / this.rows);
    for (const index of this.windowed ? this.near(here, chunks) : this.onward(here, chunks)) {
      if (!this.full(index) && !this.loading.has(index)) return index;
    }
    return null;
  }

  /**
   * @param {number} here
   * @param {number} chunks
   */
  *near(here, chunks) {
    for (let away = 0; away <= AHEAD; away++) {
      if (here + away < chunks) yield here + away;
      if (away && away <= BEHIND && here >= away) yield here - away;
    }
    if (!this.growing && !this.standing.correction && this.nearest(this.last) !== this.last) yield chunks - 1;
  }

  /**
   * @param {number} here
   * @param {number} chunks
   */
  *onward(here, chunks) {
    const most = Math.max(4, Math.floor(MOST_BYTES / (this.rows * (8 * this.joints + 40))));
    for (let away = 0; away < Math.min(chunks, most); away++) yield (here + away) % chunks;
  }

  // Fetches until everything that is wanted is here.
  load() {
    while (!this.ended && this.chain && this.loading.size < AT_ONCE) {
      const index = this.next();
      if (index === null) return;
      this.fetchChunk(index, this.id);
    }
  }

  /**
   * @param {number} index
   * @param {string | null} id
   */
  async fetchChunk(index, id) {
    this.loading.add(index);
    try {
      const missing = Math.max(0, this.chunks.get(index)?.batches.indexOf(null) ?? 0);
      const batch = await this.source.batch({ from: index * this.rows + missing, to: Math.min(this.total, (index + 1) * this.rows) });
      if (id !== this.id) return;
      if (!batch || batch.header.id !== id) { this.begunAnew(); return; }
      this.take(batch);
      this.tell("loaded", index);
    } catch (error) {
      if (error instanceof DamagedError) { this.damaged(error.message); return; }
      await pauseAfter(error);
    }
    if (id === this.id) { this.loading.delete(index); this.load(); }
  }

  // Lets go of what is farthest from the playhead when there is too much.
  spare() {
    const most = this.windowed ? MOST_WINDOW_BYTES : MOST_BYTES;
    const here = Math.floor(this.focus / this.rows);
    const chunks = Math.ceil(this.total / this.rows);
    const away = (/** @type {number} */ index) => (this.windowed ? Math.abs(index - here) : (index - here + chunks) % chunks);
    while (this.chunks.size > 4 && this.bytes > most) {
      this.chunks.delete([...this.chunks.keys()].reduce((a, b) => (away(a) > away(b) ? a : b)));
    }
  }

  // Of the frames that are here.
  get bytes() {
    /** @type {Set<Rows>} */
    const batches = new Set();
    for (const chunk of this.chunks.values()) for (const batch of chunk.batches) if (batch) batches.add(batch);
    return [...batches].reduce((sum, { bytes }) => sum + bytes, 0);
  }

  // The nearest frame that is here.
  /** @param {number} frame */
  nearest(frame) {
    for (let away = 0; away <= this.last; away++) {
      for (const k of [frame - away, frame + away]) {
        if (k >= 0 && k <= this.last && this.chunks.get(Math.floor(k / this.rows))?.batches[k % this.rows]) return k;
      }
    }
    return null;
  }

  /**
   * @param {number} frame
   * @returns {Row | null}
   */
  row(frame) {
    const chunk = this.chunks.get(Math.floor(frame / this.rows));
    const k = frame % this.rows;
    return chunk ? chunk.batches[k]?.row(chunk.at[k]) ?? null : null;
  }

  // The moment at a frame, between two when it is not whole; the nearest one that is here until the
  // right one is. Centres in pitches. From now on what is around it is fetched first.
  /** @param {number} frame */
  snapshot(frame) {
    const before = Math.floor(this.focus / this.rows);
    this.focus = Math.floor(Math.min(Math.max(frame, 0), this.last));
    const found = this.peek(frame);
    if (!found?.exact || Math.floor(this.focus / this.rows) !== before) this.load();
    return found;
  }

  // The same, of what is here.
  /**
   * @param {number} frame
   * @returns {Snapshot | null}
   */
  peek(frame) {
    const at = Math.min(Math.max(frame, 0), this.last);
    const there = this.row(Math.floor(at));
    const exact = there !== null;
    const low = exact ? Math.floor(at) : this.nearest(Math.floor(at));
    let row = there ?? (low === null ? null : this.row(low));
    if (low === null || !row) return null;
    const share = at - low;
    const after = exact && share > 1e-6 ? this.row(low + 1) : null;
    const time = row.time_s + (after ? (after.time_s - row.time_s) * share : 0);
    if (after) row = this.how.between(row, after, share);
    row = { ...row, wxyz: this.standing.turned(row.wxyz, at) };
    const poses = this.how.poses(this.kinematics, row);
    const told = row;
    return {
      frame: at, exact, low, time_s: time, phase: this.outline.names[told.phase],
      angle: (j) => this.how.angle(told, j), errors: told.errors, framed: this.framed(poses), ...poses,
    };
  }

  // How many modules, from the first on, a camera should have in view; as web/pictures/camera.py tells.
  /** @param {WindowPoses} poses */
  framed({ rod = Infinity }) { return Math.min(this.chain.modules, rod + 1 + (this.bundle.header.camera?.stretch ?? Infinity)); }

  // How far the chain is folded at a moment, 0 to 1: into the shape that it folds into or, before it is
  // straight, the one that it comes from.
  /** @param {Snapshot} snapshot */
  folded({ phase, angle }) { return foldedness(angle, phase === "playback" ? this.foldedRad : this.startRad ?? this.foldedRad); }

  // How fast each hinge turns around a frame, in rad/s; NaN where the frames beside it are not here.
  /** @param {number} frame */
  speeds(frame) {
    const low = Math.min(Math.max(Math.floor(frame), 0), Math.max(0, this.last - 1));
    const [a, b] = [this.row(low), this.row(low + 1)];
    const found = new Float32Array(this.joints);
    if (!a || !b || a.phase !== b.phase || !(b.time_s > a.time_s)) return found.fill(NaN);
    const [begin, end] = this.differing(a, b);
    for (let j = begin; j < end; j++) found[j] = (this.how.angle(b, j) - this.how.angle(a, j)) / (b.time_s - a.time_s);
    return found;
  }

  // From which hinge to before which two rows may differ.
  /**
   * @param {Row} a
   * @param {Row} b
   * @returns {number[]}
   */
  differing(a, b) { return this.windowed ? reach(/** @type {WindowRow} */ (a), /** @type {WindowRow} */ (b)) : [0, this.joints]; }

  // The largest error of the hinges of the joint that each module carries; NaN where none is recorded.
  /** @param {Floats} errors */
  moduleErrors(errors) { return this.carried(errors, (a, b) => Math.max(Math.abs(a), Math.abs(b))); }

  // A figure of each hinge as one of each module: those of the joint that it carries, put together.
  /**
   * @param {Floats} values
   * @param {(a: number, b: number) => number} together
   */
  carried(values, together) {
    const { modules, rigid_links: rigid, hinges } = this.chain;
    const joints = Math.max(1, this.joints / hinges);
    const found = new Float32Array(modules);
    for (let i = 0; i < modules; i++) {
      const first = Math.min(Math.max(i - rigid, 0), joints - 1) * hinges;
      let value = together(values[first], values[first]);
      for (let k = 1; k < hinges; k++) value = together(value, values[first + k]);
      found[i] = value;
    }
    return found;
  }
}

// The hinges that move in one of two windows, or both.
/**
 * @param {WindowRow} a
 * @param {WindowRow} b
 */
const reach = (a, b) => [Math.min(a.first, b.first), Math.max(a.last, b.last)];

// Pauses before the next try: as long as the service asks, or a moment if the connection broke.
/** @param {unknown} error */
const pauseAfter = (error) => pause(error instanceof RefusedError ? error.pauseMs : 4 * RETRY_MS);

const pause = (/** @type {number} */ ms) => new Promise((done) => { setTimeout(done, ms); });
