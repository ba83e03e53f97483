// A plan file, checked against what it says of itself.
import { KNOWN, Module } from "./module.js";
import { readable, readNpz } from "./npz.js";

/** @typedef {import("./npz.js").Column} Column */
/** @typedef {{ modules: [number, number], frame: number, gap: number }} Place the gap in widths of a module's cell */

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

const SLIP = 1e-6; // radians by which a hinge may stand beside its first, last or widest angle

/** @type {(values: ArrayLike<number>) => number} largest of their sizes, Infinity if one is no number */
const widest = (values) => {
  let found = 0;
  for (let k = 0; k < values.length; k++) if (!(Math.abs(values[k]) <= found)) found = Math.abs(values[k]) || Infinity;
  return found;
};
/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => boolean} */
const near = (a, b) => a.length === b.length && Array.prototype.every.call(a, (x, k) => Math.abs(x - b[k]) <= SLIP);
/** @type {(values: ArrayLike<number>, from: number) => boolean} */
const rise = (values, from) => Array.prototype.every.call(values, (x, k) => Number.isFinite(x) && x >= (k ? values[k - 1] : from));

/** Whole numbers from four planes of their bytes, signs folded in. @param {Column} planes */
function whole({ values, shape }) {
  readable(shape.length === 2 && shape[0] === 4, "angles in other planes than four");
  const count = shape[1];
  const found = new Int32Array(count);
  for (let k = 0; k < count; k++) {
    const code = (Number(values[k]) | Number(values[count + k]) << 8 | Number(values[2 * count + k]) << 16 | Number(values[3 * count + k]) << 24) >>> 0;
    found[k] = (code >>> 1) ^ -(code & 1);
  }
  return found;
}

export class Plan {
  /**
   * @param {Uint8Array<ArrayBuffer>} bytes
   * @returns {Promise<Plan>}
   */
  static async read(bytes) {
    try {
      const arrays = await readNpz(bytes);
      const plan = new Plan(arrays, JSON.parse(String(arrays.get("plan")?.values[0])));
      await plan.agrees();
      return plan;
    } catch (error) {
      if (error instanceof NotProved) throw error;
      throw new NotProved(`no readable plan (${error instanceof Error ? error.message : error})`);
    }
  }

  /**
   * @param {Map<string, Column>} arrays
   * @param {any} told what the plan says of itself
   */
  constructor(arrays, told) {
    this.arrays = arrays;
    this.told = told;
    const { chain, certificate, claim } = told;
    this.n = chain.modules;
    this.kind = String(chain.module);
    this.size = Number(certificate.module_size);
    this.claim = Number(certificate.clearance_bound);
    const known = Object.hasOwn(KNOWN, this.kind) ? KNOWN[this.kind] : null;
    const geometry = claim?.module ?? known;
    required(!known || JSON.stringify(geometry) === JSON.stringify(known), `another module than a ${this.kind}`);
    required(this.size > 0 && this.size <= 1, `a module size of ${this.size}`);
    this.module = new Module(geometry, this.size);
    this.pad = geometry.rigid_links * this.module.hinges;
    this.slots = (this.n - 1) * this.module.hinges;
    /** @type {Float64Array} angles of all hinges when folded */
    this.folded = Float64Array.from(chain.folded_rad);
    readable(this.folded.length === this.slots - this.pad && this.n >= 2 && Number.isInteger(this.n), `${this.folded.length} hinges for ${this.n} modules`);
    this.windowed = arrays.has("first");
    const { first, offsets, values } = this.windowed ? this.windows() : this.dense();
    /** In frame k hinges first[k] to last[k] stand at values[offsets[k]] and on, those before as folded, those behind at 0. */
    this.first = first;
    this.offsets = offsets;
    this.last = first.map((a, k) => a + offsets[k + 1] - offsets[k]);
    this.values = values;
    this.frames = first.length;
    this.most = Math.max(widest(values), widest(this.folded));
  }

  /**
   * @param {string} name
   * @returns {Float64Array}
   */
  numbers(name) {
    const values = this.arrays.get(name)?.values;
    readable(values instanceof Float64Array, `no numbers ${name}`);
    return values;
  }

  dense() {
    const { arrays, told } = this, J = this.folded.length;
    const stored = arrays.get("joint_angles_rad");
    let q = stored?.values;
    if (!stored) {
      const { differences, step_rad: step } = told.angles;
      const steps = Float64Array.from(whole(/** @type {Column} */ (arrays.get("angle_planes"))));
      for (let d = 0; d < differences; d++) for (let k = J; k < steps.length; k++) steps[k] += steps[k - J];
      q = steps.map((k) => k * step);
    }
    readable(q instanceof Float64Array, "no angles");
    const shape = stored?.shape ?? told.angles.shape;
    required(shape.length === 2 && shape[1] === J && shape[0] > 0 && q.length === shape[0] * J, `angles of the shape ${shape} for ${J} hinges`);
    return { first: new Float64Array(shape[0]), offsets: Float64Array.from({ length: shape[0] + 1 }, (_, k) => k * J), values: q };
  }

  windows() {
    const { arrays, told, folded } = this, J = folded.length;
    const first = this.numbers("first"), offsets = this.numbers("offsets");
    required(first.length && offsets.length === first.length + 1 && offsets[0] === 0 && rise(offsets, 0)
      && first.every((a, k) => a >= 0 && a + offsets[k + 1] - offsets[k] <= J), "windows that do not lie within the chain");
    const planes = arrays.get("angle_planes");
    const changes = planes ? whole(planes) : this.numbers("angles_rad");
    required(changes.length === offsets[first.length], "another number of angles than the windows need");
    if (changes instanceof Float64Array) return { first, offsets, values: changes };
    const step = told.angles.step_rad;
    const now = new Float64Array(J), values = new Float64Array(changes.length);
    for (let k = 0, low = 0, high = 0; k < first.length; k++) {
      const a = first[k], b = a + offsets[k + 1] - offsets[k];
      for (let h = a; k && h < Math.min(low, b); h++) now[h] = Math.round(folded[h] / step);
      for (let h = Math.max(high, a); k && h < b; h++) now[h] = 0;
      for (let h = a; h < b; h++) values[offsets[k] + h - a] = Math.fround((now[h] += changes[offsets[k] + h - a]) * step);
      [low, high] = [a, b];
    }
    return { first, offsets, values };
  }

  async agrees() {
    const { module: m, told, n } = this, { told: geometry } = m, said = told.certificate;
    required(m.sound, "a joint that stretches, or a module that is no solid");
    const names = Array.from({ length: n - 1 - geometry.rigid_links }, (_, i) => geometry.hinges.map((h) => `joint_${i + geometry.rigid_links}${h}`));
    required(JSON.stringify(names.flat()) === JSON.stringify(this.arrays.get("joint_names")?.values), "other names of the hinges, or another order");
    required(String(said.verdict).startsWith("verified"), `the plan itself says: ${said.verdict}`);
    required(this.claim > 0 && Number.isFinite(this.claim), "the plan claims no clearance");
    const exempt = said.exempt_pairs ?? { apart: geometry.apart, count: (geometry.apart - 1) * (n - 1) };
    required([1, 2].includes(geometry.apart) && exempt.apart === geometry.apart && exempt.count === (geometry.apart - 1) * (n - 1),
      "other pairs are exempt than those that share a joint");
    required(Number.isFinite(this.most), "angles that are not finite");
    required(this.most <= geometry.limit_rad + SLIP, `a hinge turns to ${(this.most * 180 / Math.PI).toFixed(3)} degrees`);
    required([undefined, null, this.frames].includes(said.frames), "more or fewer frames than certified");
    required(this.largestStep() <= (said.max_joint_step_rad || Infinity) + 1e-9, "a larger step of a hinge than the plan says");
    const times = this.numbers("time_s");
    required(times.length === this.frames && rise(times, -Infinity), "times that do not rise from frame to frame");
    const start = told.start ? told.start.folded_rad : new Float64Array(this.folded.length);
    required(near(this.frame(0), start), told.start ? "does not begin as it says" : "does not begin straight");
    required(near(this.frame(this.frames - 1), this.folded), "does not end folded");
    const digest = told.claim?.angles_sha256;
    required(!digest || digest === await this.digest(), "the angles are not those of the digest");
  }

  largestStep() {
    let found = 0;
    for (let k = 1; k < this.frames; k++) {
      const low = Math.min(this.first[k - 1], this.first[k]), high = Math.max(this.last[k - 1], this.last[k]);
      for (let h = low; h < high; h++) found = Math.max(found, Math.abs(this.angle(k, h) - this.angle(k - 1, h)));
    }
    return found;
  }

  /** @type {(k: number, h: number) => number} */
  angle(k, h) {
    if (h < this.first[k]) return this.folded[h];
    return h < this.last[k] ? this.values[this.offsets[k] + h - this.first[k]] : 0;
  }

  /** Of windows, their places too; in the order and the kinds of numbers that the claim tells. */
  async digest() {
    const places = this.windowed ? [...this.first, ...this.offsets] : [];
    const values = this.windowed ? Float32Array.from(this.values) : this.values;
    const bytes = new Uint8Array(8 * places.length + values.byteLength);
    new BigInt64Array(bytes.buffer, 0, places.length).set(places.map(BigInt));
    bytes.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), 8 * places.length);
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    return Array.from(hash, (byte) => byte.toString(16).padStart(2, "0")).join("");
  }

  /** Angles of a chain's slots in a frame, rigid links' too, from one slot on; those beyond the chain stand at 0. */
  /**
   * @param {number} k
   * @param {number} [low]
   * @param {Float64Array} [out]
   */
  frame(k, low = this.pad, out = new Float64Array(this.folded.length)) {
    const a = this.first[k], b = this.last[k], from = this.offsets[k] - a;
    for (let s = 0; s < out.length; s++) {
      const h = low + s - this.pad;
      if (h >= a || h < 0) out[s] = h >= a && h < b ? this.values[from + h] : 0;
      else out[s] = this.folded[h];
    }
    return out;
  }
}
