// Frames of a fold, loaded progressively, and the poses of a moment.
// Scrubbing over loaded frames needs no requests; see frames.js.
import { decode } from "../lib/columns.js";
import { FrameStore, Rows, angleIn, between, differing } from "./frames.js";
import { Kinematics, Standing, foldedness, touching } from "./kinematics.js";

/** @type {Record<string, string>} */
export const PHASES = { explosion: "Unfolding", unfolding: "Unfolding", playback: "Folding" };

const AT_ONCE = 2; // concurrent requests
const COARSE = 64; // frames to fetch first, spread over the whole timeline
const RETRY_MS = 300;
const QUICK_RETRY_MS = 50; // pause between requests for the first frames of a new fold
const MAX_QUICK_TRIES = 40; // such requests, after which the fold is assumed to wait in the queue
const LOOK_MS = 1000;
const MAX_LOOKS = 1800; // half an hour
const WAIT_S = 1;
const DAMAGED = 500; // stored data is corrupt

const BUSY = 429; // too many requests of this visitor are waiting

// An object with events that have a name and a detail.
export class Emitter extends EventTarget {
  /**
   * @param {string} name
   * @param {unknown} [detail]
   */
  tell(name, detail = null) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  /**
   * @template Told
   * @param {string} name
   * @param {(detail: Told) => void} heard
   */
  on(name, heard) {
    this.addEventListener(name, (event) => heard(/** @type {CustomEvent<Told>} */ (event).detail));
  }
}

/**
 * What a timeline begins with; `first` holds at least its first frame.
 * @typedef {{ bundle: Bundle, first: Batch }} Opening
 */

class DamagedError extends Error {}

// The service refused a request; another try after a pause may succeed.
export class RefusedError extends Error {
  /** @param {Response} answer */
  constructor(answer) {
    super(`The request failed: the server answered with status ${answer.status}.`);
    const retryS = answer.status === BUSY ? Number(answer.headers.get("Retry-After")) : 0;
    this.pauseMs = retryS > 0 ? 1000 * retryS : 4 * RETRY_MS;
  }
}

// Source of a scene bundle and batches under an address of this server.
export class Source {
  /** @type {(address: string) => Promise<Response>} */
  static fetch = (address) => fetch(address);

  /** @param {string} under */
  constructor(under) {
    this.under = under;
  }

  /** @returns {Promise<Bundle | null>} */
  bundle() {
    return this.get("bundle");
  }

  /**
   * @param {BatchAsked} range
   * @returns {Promise<Batch | null>}
   */
  batch({ from = 0, to = null, stride = 1, wait = 0 } = {}) {
    const query = new URLSearchParams({
      from: String(from),
      stride: String(stride),
      wait: String(wait),
    });
    if (to !== null) query.set("to", String(to));
    return this.get(`batch?${query}`);
  }

  // Return a decoded message; null while there is no data.
  /**
   * @template {Message<object, object>} Told
   * @param {string} name
   * @returns {Promise<Told | null>}
   */
  async get(name) {
    const answer = await Source.fetch(`${this.under}/${name}`);
    if (answer.status === 204) return null;
    if (answer.status === DAMAGED) throw new DamagedError((await answer.json()).detail);
    if (!answer.ok) throw new RefusedError(answer);
    return /** @type {Promise<Told>} */ (
      /** @type {unknown} */ (decode(await answer.arrayBuffer()))
    );
  }
}

// A complete timeline in a single batch, which is fetched once.
export class Recording extends Source {
  /** @type {Promise<Batch | null> | undefined} */
  once;

  batch() {
    return (this.once ??= this.get("batch"));
  }
}

export class Timeline extends Emitter {
  // Chain and outline are null until the timeline has
  // begun; the next three are undefined until then.
  /** @type {Chain & Hull} */
  chain;
  /** @type {TimelineOutline} */
  outline;
  /** @type {Bundle} */
  bundle;
  /** @type {Kinematics} */
  kinematics;
  /**
   * @type {boolean} true for a long timeline, of which only the frames around the playhead are
   *   fetched
   */
  windowed;
  /** @type {Floats | null} angles at the first frame */
  startRad = null;
  standing = new Standing();
  /** @type {number | undefined} */
  sharedScale;
  /** @type {string | null} */
  id;
  /** @type {BatchHeader["status"]} */
  status;
  store = new FrameStore();
  version = 0; // incremented with every batch

  // `over`: the fold is over and no more frames follow, whatever the status of the timeline is.
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
    this.early = null; // bundle of a timeline without frames
    this.looks = 0;
    this.tries = 0;
    this.grown = false; // true once the timeline has grown on this page
    this.ended = false;
    this.running = false;
    this.forget();
    this.run();
  }

  forget() {
    this.id = null;
    this.chain = /** @type {never} */ (null);
    this.status = "growing";
    this.outline = /** @type {never} */ (null);
    this.store = new FrameStore();
    this.version = 0;
    this.startRad = null;
    this.standing.clear();
  }

  get growing() {
    return this.status === "growing" && !this.over;
  }

  // The joint error at which a module is fully red; timelines side by side share it.
  get errorScale() {
    return Math.max(this.outline.error_scale_rad, this.sharedScale ?? 0);
  }

  get foldedRad() {
    return this.bundle.arrays.folded_rad;
  }

  get joints() {
    return this.foldedRad.length;
  }

  get total() {
    return this.store.total;
  }

  get last() {
    return this.store.last;
  }

  stop() {
    this.ended = true;
  }

  // Mark the fold as over and check for final frames.
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
        else if (this.growing) {
          this.grown = true;
          await this.fetchNext(WAIT_S);
        } else if (this.unsure && this.looks < MAX_LOOKS) await this.look();
        else break;
      } catch (error) {
        if (error instanceof DamagedError) this.damaged(error.message);
        else await pauseAfter(error); // loaded frames stay
      }
    }
    this.running = false;
    if (this.over && !this.ended) this.tell("settled");
  }

  // Fetch the frames after the loaded ones. Return false if the timeline was replaced.
  async fetchNext(wait = 0) {
    const { id } = this;
    const batch = await this.source.batch({ from: this.total, wait });
    if (id !== this.id) return false;
    if (batch?.header.id !== id) {
      this.begunAnew();
      return false;
    }
    const before = [this.total, this.status];
    this.take(batch);
    if (this.total !== before[0] || this.status !== before[1]) this.tell("grew");
    this.load();
    return true;
  }

  // Poll a complete timeline while the fold is running: it restarts if its plan is refused.
  async look() {
    if (!this.over) await pause(LOOK_MS);
    this.looks++;
    const { over } = this;
    if ((await this.fetchNext()) && over) this.unsure = false;
  }

  // Stop and drop the motion; the page shows the reason.
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

  // Begin with the first frame, or wait for it.
  async begin() {
    const opening = this.tries ? await this.openWithFrames() : await this.openAtOnce();
    if (!opening) {
      this.tell("waiting");
      await pause(this.tries++ < MAX_QUICK_TRIES ? QUICK_RETRY_MS : RETRY_MS);
      return;
    }
    const { bundle, first } = opening;
    this.windowed = "first" in first.arrays;
    const spread = await this.spreadFrames(first.header);
    this.openWith(bundle, first.header.id);
    this.take(first);
    const start = this.row(0);
    if (start)
      this.startRad = Float32Array.from({ length: this.joints }, (_, j) => angleIn(start, j));
    if (spread?.header.id === this.id) this.take(spread);
    this.tell("begun");
    this.load();
  }

  // Fetch what a timeline begins with, in one round trip. Return null if it has no frames yet.
  /** @returns {Promise<Opening | null>} */
  async openAtOnce() {
    const [bundle, first] = await Promise.all([this.source.bundle(), this.source.batch({ to: 1 })]);
    return bundle && first?.header.total ? { bundle, first } : null;
  }

  // The same for a timeline that had no frames at the last try: only a batch
  // is requested until it has some, and the bundle once it exists without any.
  /** @returns {Promise<Opening | null>} */
  async openWithFrames() {
    const first = await this.source.batch({ to: 1 });
    if (!first) return null;
    const { id, total } = first.header;
    if (!total) {
      if (this.early?.id !== id)
        this.early = { id, bundle: this.source.bundle().catch(() => null) };
      return null;
    }
    const early = this.early?.id === id ? await this.early.bundle : null;
    const bundle = early ?? (await this.source.bundle());
    return bundle && { bundle, first };
  }

  // Fetch frames spread over the whole timeline, including the last, so that scrubbing
  // works at once. Return null if the first batch holds all, or if there is no last frame yet.
  /** @param {BatchHeader} header of the first batch */
  async spreadFrames({ total, status }) {
    const stride = Math.ceil(total / COARSE);
    if (stride === 1 || (status === "growing" && !this.windowed)) return null;
    return this.source.batch({ from: (total - 1) % stride, stride });
  }

  /**
   * @param {Bundle} bundle
   * @param {string} id
   */
  openWith(bundle, id) {
    const { header } = bundle;
    this.bundle = bundle;
    this.chain = header.chain;
    this.kinematics = new Kinematics(header.chain, this.foldedRad);
    if (this.windowed && header.sketch.parts.length === 1)
      bundle.neighbours = touching(header, this.kinematics.folded);
    this.store = new FrameStore(this.joints, this.windowed);
    this.id = id;
  }

  // Store the frames and the header of a batch.
  /** @param {Batch} batch */
  take(batch) {
    const { header } = batch;
    const { store } = this;
    store.put(new Rows(batch, this.foldedRad), header);
    // A growing timeline may have more frames than this batch; they are requested next.
    store.total =
      this.growing && header.status === "growing" && !this.windowed
        ? Math.max(store.total, header.stop)
        : header.total;
    this.status = header.status;
    this.outline = header.outline;
    this.version++;
    this.stand();
    store.spare();
  }

  // Rotate the fold so that its last frame, once loaded, has the orientation of the drawing.
  stand() {
    const {
      standing,
      outline,
      bundle: { header },
      windowed,
    } = this;
    if (this.growing) {
      standing.clear();
      return;
    }
    const folding = outline.phases?.findLast(({ name }) => name === "playback");
    const end = folding && !header.table && !standing.correction ? this.row(this.last) : null;
    if (!end || !folding || !header.chain.folded_wxyz) return;
    standing.set(
      end.wxyz,
      windowed ? header.chain.folded_wxyz : header.chain.folded_root_wxyz,
      folding,
      this.grown,
    );
  }

  // True if all required frames are loaded.
  get complete() {
    return this.chain !== null && !this.growing && !this.store.loading.size && this.next === null;
  }

  // The chunk to fetch next; the correction of the orientation needs the last frame.
  get next() {
    return this.store.next(!this.growing && !this.standing.correction);
  }

  // Fetch chunks until all required frames are loaded.
  load() {
    while (!this.ended && this.chain && this.store.loading.size < AT_ONCE) {
      const { next } = this;
      if (next === null) return;
      this.fetchChunk(next, this.store);
    }
  }

  /**
   * @param {number} index
   * @param {FrameStore} store replaced if the timeline restarts
   */
  async fetchChunk(index, store) {
    store.loading.add(index);
    try {
      const batch = await this.source.batch(store.missing(index));
      if (store !== this.store) return;
      if (batch?.header.id !== this.id) {
        this.begunAnew();
        return;
      }
      this.take(batch);
      this.tell("loaded", index);
    } catch (error) {
      if (error instanceof DamagedError) {
        this.damaged(error.message);
        return;
      }
      await pauseAfter(error);
    }
    store.loading.delete(index);
    if (store === this.store) this.load();
  }

  // Return the nearest loaded frame.
  /** @param {number} frame */
  nearest(frame) {
    return this.store.nearest(frame);
  }

  /** @param {number} frame */
  row(frame) {
    return this.store.row(frame);
  }

  // Return the moment at a fractional frame, or at the nearest loaded frame until that one is
  // loaded; centres in pitches. Frames around it are fetched first from now on.
  /** @param {number} frame */
  snapshot(frame) {
    const { store } = this;
    const before = store.focusChunk;
    store.focus = Math.floor(Math.min(Math.max(frame, 0), this.last));
    const moment = this.peek(frame);
    if (!moment?.exact || store.focusChunk !== before) this.load();
    return moment;
  }

  // Return the same moment without changing the order of fetches.
  /**
   * @param {number} frame
   * @returns {Snapshot | null}
   */
  peek(frame) {
    const at = Math.min(Math.max(frame, 0), this.last);
    const exactRow = this.row(Math.floor(at));
    const exact = exactRow !== null;
    const low = exact ? Math.floor(at) : this.nearest(Math.floor(at));
    let row = exactRow ?? (low === null ? null : this.row(low));
    if (low === null || !row) return null;
    const share = at - low;
    const after = exact && share > 1e-6 ? this.row(low + 1) : null;
    const time = row.time_s + (after ? (after.time_s - row.time_s) * share : 0);
    if (after) row = between(row, after, share);
    row = { ...row, wxyz: this.standing.turned(row.wxyz, at) };
    const poses = this.windowed
      ? this.kinematics.windowPoses(row)
      : this.kinematics.poses(row.angles, row.position, row.wxyz);
    const storedRow = row;
    return {
      frame: at,
      exact,
      low,
      time_s: time,
      phase: this.outline.names[storedRow.phase],
      angle: (j) => angleIn(storedRow, j),
      errors: storedRow.errors,
      framed: this.framed(poses),
      ...poses,
    };
  }

  // Return the number of modules, from the first on, to keep in view, as in web/pictures/camera.py.
  /** @param {WindowPoses} poses */
  framed({ rod = Infinity }) {
    return Math.min(this.chain.modules, rod + 1 + (this.bundle.header.camera?.stretch ?? Infinity));
  }

  // Return the progress of folding at a moment, 0 to 1: towards the
  // shape or, during the explosion, relative to the first frame.
  /** @param {Snapshot} snapshot */
  folded({ phase, angle }) {
    return foldedness(
      angle,
      phase === "playback" ? this.foldedRad : (this.startRad ?? this.foldedRad),
    );
  }

  // Return the speed of each hinge at a frame, in rad/s; NaN if the adjacent frames are not loaded.
  /** @param {number} frame */
  speeds(frame) {
    const low = Math.min(Math.max(Math.floor(frame), 0), Math.max(0, this.last - 1));
    const [a, b] = [this.row(low), this.row(low + 1)];
    const speeds = new Float32Array(this.joints);
    if (!a || !b || a.phase !== b.phase || !(b.time_s > a.time_s)) return speeds.fill(NaN);
    const [firstHinge, endHinge] = differing(a, b);
    for (let j = firstHinge; j < endHinge; j++)
      speeds[j] = (angleIn(b, j) - angleIn(a, j)) / (b.time_s - a.time_s);
    return speeds;
  }

  // Convert values per hinge to values per module: the
  // largest absolute value of the joint that it carries.
  /** @param {Floats} values */
  perModule(values) {
    const { modules, rigid_links: rigid, hinges } = this.chain;
    const joints = Math.max(1, this.joints / hinges);
    const largest = new Float32Array(modules);
    for (let i = 0; i < modules; i++) {
      const first = Math.min(Math.max(i - rigid, 0), joints - 1) * hinges;
      for (let j = first; j < first + hinges; j++)
        largest[i] = Math.max(largest[i], Math.abs(values[j]));
    }
    return largest;
  }
}

// Pause before the next try: as long as the service asks, or briefly after a connection error.
/** @param {unknown} error */
const pauseAfter = (error) => pause(error instanceof RefusedError ? error.pauseMs : 4 * RETRY_MS);

const pause = (/** @type {number} */ ms) =>
  new Promise((done) => {
    setTimeout(done, ms);
  });
