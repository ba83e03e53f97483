// A fold's frames as they come in: where they are kept, which are fetched next, and the poses of a
// moment. What has been fetched once is scrubbed without a word to the server.
import { decode } from "./columns.js";
import { Kinematics } from "./kinematics.js";
import { Teller } from "./teller.js";

const AT_ONCE = 2; // requests
const COARSE = 64; // frames that are fetched first, spread over the whole film
const REEL_BYTES = 2 ** 20;
const LONGEST_REEL = 128;
const MOST_BYTES = 384 * 2 ** 20;
const RETRY_MS = 300;
const LOOK_MS = 1000;
const MOST_LOOKS = 1800; // half an hour
const WAIT_S = 1;

// Scenery and reels under an address of this server.
export class Source {
  constructor(under) { this.under = under; }

  scenery() { return this.get("scenery"); }

  reel({ from = 0, to = null, stride = 1, wait = 0 } = {}) {
    const asked = new URLSearchParams({ from, stride, wait });
    if (to !== null) asked.set("to", to);
    return this.get(`reel?${asked}`);
  }

  // What a browser can take apart, or null while there is nothing.
  async get(what) {
    const answer = await fetch(`${this.under}/${what}`);
    if (answer.status === 204) return null;
    if (!answer.ok) throw new Error(`The server answered ${answer.status}.`);
    return decode(await answer.arrayBuffer());
  }
}

export class Film extends Teller {
  // `over` says that nothing more comes: the fold is over, whatever its timeline says.
  constructor(source, { over = true } = {}) {
    super();
    this.source = source;
    this.over = over;
    this.unsure = !over;
    this.looks = 0;
    this.ended = false;
    this.running = false;
    this.forget();
    this.run();
  }

  forget() {
    this.id = null;
    this.chain = null;
    this.total = 0;
    this.status = "growing";
    this.outline = null;
    this.chunks = new Map();
    this.loading = new Set();
    this.focus = 0;
    this.version = 0;
  }

  get growing() { return this.status === "growing" && !this.over; }

  // The joint error at which a module is fully red; films beside each other share one.
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
      } catch {
        await pause(4 * RETRY_MS); // the connection broke; what is here stays
      }
    }
    this.running = false;
  }

  // While a fold goes on, a timeline that is complete may yet be begun anew: its plan was refused.
  async look() {
    if (!this.over) await pause(LOOK_MS);
    this.looks++;
    const { id, over } = this;
    const reel = await this.source.reel({ from: this.total });
    if (id !== this.id) return;
    if (!reel || reel.header.id !== id) { this.begunAnew(); return; }
    const before = [this.total, this.status];
    this.take(reel);
    if (over) this.unsure = false;
    if (this.total !== before[0] || this.status !== before[1]) this.tell("grew");
    this.load();
  }

  begunAnew() {
    this.forget();
    this.tell("waiting");
    this.run();
  }

  async begin() {
    const [scenery, first] = await Promise.all([this.source.scenery(), this.source.reel({ to: 1 })]);
    if (!scenery || !first || !first.header.total) {
      this.tell("waiting");
      await pause(RETRY_MS);
      return;
    }
    // Frames spread over the whole film, so that it can be scrubbed everywhere at once.
    const stride = Math.ceil(first.header.total / COARSE);
    const spread = stride > 1 && first.header.status !== "growing" ? await this.source.reel({ stride }) : null;
    const { header, arrays } = scenery;
    this.scenery = scenery;
    this.chain = header.chain;
    this.joints = arrays.folded_rad.length;
    this.foldedRad = arrays.folded_rad;
    this.foldedPositions = arrays.folded_positions;
    this.kinematics = new Kinematics(header.chain);
    this.rows = Math.max(1, Math.min(LONGEST_REEL, Math.floor(REEL_BYTES / (8 * this.joints + 40))));
    this.id = first.header.id;
    this.take(first);
    if (spread?.header.id === this.id) this.take(spread);
    this.tell("begun");
    this.load();
  }

  async grow() {
    const reel = await this.source.reel({ from: this.total, wait: WAIT_S });
    if (!reel || reel.header.id !== this.id) { this.begunAnew(); return; }
    const before = [this.total, this.status];
    this.take(reel);
    if (this.total !== before[0] || this.status !== before[1]) this.tell("grew");
    this.load();
  }

  // Keeps what a reel brings.
  take({ header, arrays }) {
    const { start, stop, stride } = header;
    for (let row = 0, frame = start; frame < stop; row++, frame += stride) {
      const chunk = this.chunk(Math.floor(frame / this.rows));
      const k = frame % this.rows;
      const copy = (name, width) => chunk[name].set(arrays[name].subarray(row * width, (row + 1) * width), k * width);
      copy("time_s", 1); copy("phase", 1); copy("root_position", 3); copy("root_wxyz", 4);
      copy("joint_angles_rad", this.joints); copy("joint_error_rad", this.joints);
      if (!chunk.have[k]) { chunk.have[k] = 1; chunk.count++; }
    }
    // A film that grows may have more than this reel; what is missing is asked for next.
    this.total = this.growing && header.status === "growing" ? Math.max(this.total, stop) : header.total;
    this.status = header.status;
    this.outline = header.outline;
    this.version++;
  }

  chunk(index) {
    let chunk = this.chunks.get(index);
    if (!chunk) {
      const n = this.rows;
      chunk = {
        count: 0,
        have: new Uint8Array(n),
        time_s: new Float64Array(n),
        phase: new Uint8Array(n),
        root_position: new Float32Array(3 * n),
        root_wxyz: new Float32Array(4 * n),
        joint_angles_rad: new Float32Array(n * this.joints),
        joint_error_rad: new Float32Array(n * this.joints),
      };
      this.chunks.set(index, chunk);
    }
    return chunk;
  }

  full(index) {
    const chunk = this.chunks.get(index);
    return Boolean(chunk) && chunk.count >= Math.min(this.rows, this.total - index * this.rows);
  }

  get complete() { return !this.growing && this.next() === null; }

  // The chunk to fetch next: those around the playhead first; null when all are here.
  next() {
    const chunks = Math.ceil(this.total / this.rows);
    const here = Math.floor(this.focus / this.rows);
    const most = Math.max(4, Math.floor(MOST_BYTES / (this.rows * (8 * this.joints + 40))));
    for (let away = 0; away < Math.min(chunks, most); away++) {
      const index = (here + away) % chunks;
      if (!this.full(index) && !this.loading.has(index)) return index;
    }
    return null;
  }

  // Fetches until everything is here, or as much as is kept.
  load() {
    while (!this.ended && this.chain && this.loading.size < AT_ONCE) {
      const index = this.next();
      if (index === null) return;
      this.fetchChunk(index, this.id);
    }
  }

  async fetchChunk(index, id) {
    this.loading.add(index);
    try {
      const reel = await this.source.reel({ from: index * this.rows, to: Math.min(this.total, (index + 1) * this.rows) });
      if (id !== this.id) return;
      if (!reel || reel.header.id !== id) { this.begunAnew(); return; }
      this.take(reel);
      this.spare();
      this.tell("loaded", index);
    } catch {
      await pause(4 * RETRY_MS);
    }
    if (id === this.id) { this.loading.delete(index); this.load(); }
  }

  // Lets go of what is farthest from the playhead when there is too much.
  spare() {
    const most = Math.max(4, Math.floor(MOST_BYTES / (this.rows * (8 * this.joints + 40))));
    const here = Math.floor(this.focus / this.rows);
    const chunks = Math.ceil(this.total / this.rows);
    while (this.chunks.size > most) {
      const away = (index) => (index - here + chunks) % chunks;
      this.chunks.delete([...this.chunks.keys()].reduce((a, b) => (away(a) > away(b) ? a : b)));
    }
  }

  // The nearest frame that is here.
  nearest(frame) {
    for (let away = 0; away <= this.last; away++) {
      for (const k of [frame - away, frame + away]) {
        if (k >= 0 && k <= this.last && this.chunks.get(Math.floor(k / this.rows))?.have[k % this.rows]) return k;
      }
    }
    return null;
  }

  row(frame) {
    const chunk = this.chunks.get(Math.floor(frame / this.rows));
    const k = frame % this.rows;
    if (!chunk?.have[k]) return null;
    const part = (name, width) => chunk[name].subarray(k * width, (k + 1) * width);
    return {
      time_s: chunk.time_s[k],
      phase: chunk.phase[k],
      position: part("root_position", 3),
      wxyz: part("root_wxyz", 4),
      angles: part("joint_angles_rad", this.joints),
      errors: part("joint_error_rad", this.joints),
    };
  }

  // The moment at a frame, between two when it is not whole; the nearest one that is here until the
  // right one is. Centres in pitches.
  snapshot(frame) {
    const at = Math.min(Math.max(frame, 0), this.last);
    this.focus = Math.floor(at);
    let low = Math.floor(at);
    let row = this.row(low);
    const missing = !row;
    if (missing) {
      this.load();
      low = this.nearest(low);
      if (low === null) return null;
      row = this.row(low);
    }
    const share = at - low;
    const after = !missing && share > 1e-6 ? this.row(low + 1) : null;
    let { angles, position, wxyz, time_s: time } = row;
    if (after) {
      const mix = (a, b) => Float64Array.from(a, (v, k) => v + (b[k] - v) * share);
      const same = wxyz.reduce((sum, v, k) => sum + v * after.wxyz[k], 0) >= 0;
      angles = mix(angles, after.angles);
      position = mix(position, after.position);
      wxyz = mix(wxyz, same ? after.wxyz : after.wxyz.map((v) => -v));
      time += (after.time_s - time) * share;
    }
    return {
      frame: at, exact: !missing, low, time_s: time, phase: this.outline.names[row.phase],
      angles, errors: row.errors, ...this.kinematics.poses(angles, position, wxyz),
    };
  }

  // How fast each hinge turns around a frame, in rad/s; NaN where the frames beside it are not here.
  speeds(frame) {
    const low = Math.min(Math.max(Math.floor(frame), 0), Math.max(0, this.last - 1));
    const [a, b] = [this.row(low), this.row(low + 1)];
    const found = new Float32Array(this.joints);
    if (!a || !b || a.phase !== b.phase || !(b.time_s > a.time_s)) return found.fill(NaN);
    for (let j = 0; j < found.length; j++) found[j] = (b.angles[j] - a.angles[j]) / (b.time_s - a.time_s);
    return found;
  }

  // The largest error of the hinges of the joint that each module carries; NaN where none is recorded.
  moduleErrors(errors) { return this.carried(errors, (a, b) => Math.max(Math.abs(a), Math.abs(b))); }

  // A figure of each hinge as one of each module: those of the joint that it carries, put together.
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

const pause = (ms) => new Promise((done) => { setTimeout(done, ms); });
