// A plan file, checked against what it says of itself.
import { KNOWN, Module } from "./module.js";
import { readable, readNpz } from "./npz.js";

/** @typedef {import("./npz.js").Column} Column */
/** @typedef {{ modules: [number, number], frame: number, gap: number }} Place the gap in widths of a module's cell */

const SLIP = 1e-6; // radians by which a hinge may stand beside its first, last or widest angle

/** What could not be proved, and where. */
export class NotProved extends Error {
  /**
   * @param {string} message
   * @param {Place | null} [place]
   */
  constructor(message, place = null) {
    super(message);
    this.place = place;
  }
}

/**
 * @param {unknown} condition
 * @param {string} message
 * @returns {asserts condition}
 */
function required(condition, message) {
  if (!condition) throw new NotProved(message);
}

/** @type {(values: Float64Array) => number} largest of their sizes, Infinity if one is no number */
const widest = (values) => values.reduce((most, x) => Math.max(most, Number.isNaN(x) ? Infinity : Math.abs(x)), 0);
/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => boolean} */
const near = (a, b) => a.length === b.length && Array.prototype.every.call(a, (x, k) => Math.abs(x - b[k]) <= SLIP);
/** @type {(values: Float64Array) => boolean} */
const rise = (values) => values.every((x, k) => Number.isFinite(x) && (!k || x >= values[k - 1]));

/** Whole numbers from four planes of their bytes, signs folded in. @param {Column | undefined} planes */
function whole(planes) {
  readable(planes && planes.values instanceof Float64Array && planes.shape.length === 2 && planes.shape[0] === 4, "no planes of angles");
  const { values, shape: [, count] } = planes;
  return Float64Array.from({ length: count }, (_, k) => {
    const code = (values[k] | values[count + k] << 8 | values[2 * count + k] << 16 | values[3 * count + k] << 24) >>> 0;
    return (code >>> 1) ^ -(code & 1);
  });
}

export class Plan {
  /** A plan that nothing has been checked of. @param {Uint8Array<ArrayBuffer>} bytes */
  static async open(bytes) {
    const arrays = await readNpz(bytes);
    return new Plan(arrays, JSON.parse(String(arrays.get("plan")?.values[0])));
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  static async read(bytes) {
    try {
      const plan = await Plan.open(bytes);
      await plan.agrees();
      return plan;
    } catch (error) {
      throw error instanceof NotProved ? error : new NotProved(`no readable plan (${error instanceof Error ? error.message : error})`);
    }
  }

  /**
   * @param {Map<string, Column>} arrays
   * @param {any} told what the plan says of itself
   */
  constructor(arrays, told) {
    const { chain, certificate, claim } = told, known = Object.hasOwn(KNOWN, chain.module) ? KNOWN[chain.module] : null;
    const geometry = claim?.module ?? known;
    this.arrays = arrays;
    this.told = told;
    this.n = chain.modules;
    this.size = Number(certificate.module_size);
    this.claim = Number(certificate.clearance_bound);
    required(!known || JSON.stringify(geometry) === JSON.stringify(known), `another module than a ${chain.module}`);
    required(this.size > 0 && this.size <= 1, `a module size of ${this.size}`);
    this.module = new Module(geometry, this.size);
    this.pad = geometry.rigid_links * this.module.hinges;
    this.slots = (this.n - 1) * this.module.hinges;
    this.folded = Float64Array.from(chain.folded_rad);
    required(this.folded.length === this.slots - this.pad && this.n >= 2 && Number.isInteger(this.n), `${this.folded.length} hinges for ${this.n} modules`);
    required(["joint_angles_rad", "angles_rad", "angle_planes"].filter((name) => arrays.has(name)).length === 1, "angles that are not stored once");
    this.windowed = arrays.has("first");
    /** In frame k hinges first[k] to last[k] stand at values[offsets[k]] and on, those before as folded, those behind at 0. */
    const { first, offsets, values } = this.windowed ? this.windows() : this.dense();
    this.first = first;
    this.offsets = offsets;
    this.values = values;
    this.last = first.map((a, k) => a + offsets[k + 1] - offsets[k]);
    this.frames = first.length;
    this.most = Math.max(widest(values), widest(this.folded));
  }

  /** @param {string} name */
  numbers(name) {
    const values = this.arrays.get(name)?.values;
    readable(values instanceof Float64Array, `no numbers ${name}`);
    return values;
  }

  dense() {
    const { arrays, told } = this, J = this.folded.length, stored = arrays.get("joint_angles_rad");
    const values = stored ? this.numbers("joint_angles_rad") : whole(arrays.get("angle_planes")), [frames, hinges] = stored?.shape ?? told.angles.shape;
    required(frames > 0 && hinges === J && values.length === frames * J, `angles of the shape ${frames}, ${hinges} for ${J} hinges`);
    for (let d = stored ? 0 : told.angles.differences; d > 0; d--) for (let k = J; k < values.length; k++) values[k] += values[k - J];
    if (!stored) values.forEach((x, k) => { values[k] = x * told.angles.step_rad; });
    return { first: new Float64Array(frames), offsets: Float64Array.from({ length: frames + 1 }, (_, k) => k * J), values };
  }

  windows() {
    const { arrays, told, folded } = this, J = folded.length, first = this.numbers("first"), offsets = this.numbers("offsets");
    required(first.length && offsets.length === first.length + 1 && offsets[0] === 0 && rise(offsets)
      && first.every((a, k) => a >= 0 && a + offsets[k + 1] - offsets[k] <= J), "windows that do not lie within the chain");
    const packed = arrays.has("angle_planes"), values = packed ? whole(arrays.get("angle_planes")) : this.numbers("angles_rad");
    required(values.length === offsets[first.length], "another number of angles than the windows need");
    const now = new Float64Array(J), step = told.angles?.step_rad;
    for (let k = 0, low = 0, high = 0; packed && k < first.length; k++) {
      const a = first[k], b = a + offsets[k + 1] - offsets[k], from = offsets[k] - a;
      for (let h = a; h < b; h++) {
        if (k && (h < low || h >= high)) now[h] = h < low ? Math.round(folded[h] / step) : 0; // enters as folded or straight
        now[h] += values[from + h];
        values[from + h] = Math.fround(now[h] * step);
      }
      [low, high] = [a, b];
    }
    return { first, offsets, values };
  }

  async agrees() {
    const { module: { told: geometry, sound }, told, n } = this, said = told.certificate, rigid = geometry.rigid_links;
    required(sound, "a joint that stretches, or a module that is no solid");
    const names = Array.from({ length: n - 1 - rigid }, (_, i) => geometry.hinges.map((h) => `joint_${i + rigid}${h}`)).flat();
    required(JSON.stringify(names) === JSON.stringify(this.arrays.get("joint_names")?.values), "other names of the hinges, or another order");
    required(String(said.verdict).startsWith("verified"), `the plan itself says: ${said.verdict}`);
    required(this.claim > 0 && Number.isFinite(this.claim), "the plan claims no clearance");
    const { apart, count } = said.exempt_pairs ?? { apart: geometry.apart, count: (geometry.apart - 1) * (n - 1) };
    required([1, 2].includes(apart) && apart === geometry.apart && count === (apart - 1) * (n - 1), "other pairs are exempt than those that share a joint");
    required(this.most <= geometry.limit_rad + SLIP, `a hinge turns to ${(this.most * 180 / Math.PI).toFixed(3)} degrees`);
    required([undefined, null, this.frames].includes(said.frames), "more or fewer frames than certified");
    required(this.largestStep() <= (said.max_joint_step_rad || Infinity) + 1e-9, "a larger step of a hinge than the plan says");
    const times = this.numbers("time_s"), start = told.start ? told.start.folded_rad : new Float64Array(this.folded.length);
    required(times.length === this.frames && rise(times), "times that do not rise from frame to frame");
    required(near(this.frame(0), start), told.start ? "does not begin as it says" : "does not begin straight");
    required(near(this.frame(this.frames - 1), this.folded), "does not end folded");
    const digest = told.claim?.angles_sha256;
    // Browsers hash for pages of https and of localhost alone; the proof itself needs no digest.
    required(!digest || !globalThis.crypto?.subtle || digest === await this.digest(), "the angles are not those of the digest");
  }

  /** How far a hinge moves from frame to frame at most. */
  largestStep() {
    let found = 0;
    for (let k = 1; k < this.frames; k++) {
      const low = Math.min(this.first[k - 1], this.first[k]) + this.pad, count = Math.max(this.last[k - 1], this.last[k]) + this.pad - low;
      const [before, now] = [k - 1, k].map((frame) => this.frame(frame, low, new Float64Array(count)));
      for (let s = 0; s < count; s++) found = Math.max(found, Math.abs(now[s] - before[s]));
    }
    return found;
  }

  /** SHA-256 of the angles as 64-bit floats; of windows, of first and offsets as 64-bit integers, then of the angles as 32-bit floats. */
  async digest() {
    const places = this.windowed ? [...this.first, ...this.offsets] : [];
    const values = this.windowed ? Float32Array.from(this.values) : this.values;
    const bytes = new Uint8Array(8 * places.length + values.byteLength);
    new BigInt64Array(bytes.buffer, 0, places.length).set(places.map(BigInt));
    bytes.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), 8 * places.length);
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    return Array.from(hash, (byte) => byte.toString(16).padStart(2, "0")).join("");
  }

  /** Angles in a frame, of rigid links' slots too, from one slot on; those beyond the chain stand at 0. @type {(k: number, low?: number, out?: Float64Array) => Float64Array} */
  frame(k, low = this.pad, out = new Float64Array(this.folded.length)) {
    const { pad, folded, values, first: { [k]: a }, last: { [k]: b }, offsets: { [k]: offset } } = this;
    for (let s = 0, h = low - pad; s < out.length; s++, h++) out[s] = h < 0 || h >= b ? 0 : h < a ? folded[h] : values[offset + h - a];
    return out;
  }
}
