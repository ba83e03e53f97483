// Reading of a plan file, with checks of its consistency.
import { KNOWN, Module } from "./module.js";
import { readable, readNpz } from "./npz.js";

/** @typedef {import("./npz.js").Column} Column */
/** @typedef {{ modules: [number, number], frame: number, gap: number, fits: number }} Place gap, in widths of a module's cell, and largest size of modules that still fit */

const SLIP = 1e-6; // tolerance in radians of a hinge's first, last and largest angle

/** A claim that could not be proved, and its place. */
export class NotProved extends Error {
  /**
   * @param {string} message
   * @param {Place | null} [place]
   */
  constructor(message, place = null) { super(message); this.place = place; }
}

/** @type {(values: Float64Array) => number} largest absolute value; Infinity if one is not a number */
const widest = (values) => values.reduce((most, x) => Math.max(most, Number.isNaN(x) ? Infinity : Math.abs(x)), 0);
const degrees = (/** @type {number} */ angle) => `${Number((angle * (180 / Math.PI)).toFixed(4))}°`;
/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => boolean} */
const near = (a, b) => a.length === b.length && Array.prototype.every.call(a, (x, k) => Math.abs(x - b[k]) <= SLIP);
/** @type {(values: Float64Array) => boolean} */
const rise = (values) => values.every((x, k) => Number.isFinite(x) && (!k || x >= values[k - 1]));

export class Plan {
  /** Open a plan without checks. @param {Uint8Array<ArrayBuffer>} bytes */
  static async open(bytes) {
    const arrays = await readNpz(bytes);
    return new Plan(arrays, JSON.parse(String(arrays.get("plan")?.values[0])));
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  static async read(bytes) {
    try {
      const plan = await Plan.open(bytes), wrong = Object.entries(await plan.facts()).find(([, holds]) => !holds);
      readable(!wrong, String(wrong?.[0]));
      return plan;
    } catch (error) {
      throw new NotProved(`The plan cannot be read, or it contradicts itself: ${error instanceof Error ? error.message : error}.`);
    }
  }

  /**
   * @param {Map<string, Column>} arrays
   * @param {any} told the plan's own description
   */
  constructor(arrays, told) {
    const { chain, certificate, claim } = told;
    /** @type {Map<string, Column>} */
    this.arrays = arrays;
    this.told = told;
    this.n = chain.modules;
    this.size = Number(certificate.module_size);
    this.claim = Number(certificate.clearance_bound);
    this.known = Object.hasOwn(KNOWN, chain.module) ? KNOWN[chain.module] : null;
    this.module = new Module(claim?.module ?? this.known, this.size);
    this.pad = this.module.told.rigid_links * this.module.hinges;
    this.folded = Float64Array.from(chain.folded_rad);
    this.step = (certificate.max_joint_step_rad || Infinity) + 1e-9;
    this.windowed = arrays.has("first");
    const J = this.folded.length, frames = this.numbers(this.windowed ? "first" : "time_s").length;
    const expected = (this.n - 1) * this.module.hinges - this.pad;
    readable(J === expected && this.n >= 2, `got ${J} hinges for ${this.n} modules, expected ${this.n < 2 ? "at least 2 modules" : expected}`);
    /**
     * In frame k, the angles of hinges first[k] to last[k] − 1 start at
     * values[offsets[k]]; earlier hinges are folded, later ones at 0.
     */
    this.first = this.windowed ? this.numbers("first") : new Float64Array(frames);
    this.offsets = this.windowed ? this.numbers("offsets") : Float64Array.from({ length: frames + 1 }, (_, k) => k * J);
    this.last = this.first.map((a, k) => a + this.offsets[k + 1] - this.offsets[k]);
    readable(frames && this.offsets.length === frames + 1 && this.offsets[0] === 0 && rise(this.offsets)
      && this.first.every((a, k) => a >= 0 && this.last[k] <= J), "the hinges listed for the frames do not match the chain");
    this.frames = frames;
    this.values = this.angles(J);
    readable(this.values.length === this.offsets[frames], "the number of angles does not match the hinges");
    this.most = Math.max(widest(this.values), widest(this.folded));
  }

  /** @type {(name: string) => Float64Array} */
  numbers(name) {
    const values = this.arrays.get(name)?.values;
    readable(values instanceof Float64Array, `the array ${name} is missing, or has no numbers`);
    return values;
  }

  /**
   * Return the concatenated angles of all windows; stored
   * plainly, as differences of frames, or as changes in windows.
   * @param {number} J
   */
  angles(J) {
    const { arrays, told: { angles }, folded, first, last, offsets } = this, name = this.windowed ? "angles_rad" : "joint_angles_rad";
    const shape = (arrays.has(name) ? arrays.get(name) : angles)?.shape;
    readable(this.windowed || (shape?.[0] === this.frames && shape[1] === J), "the number of angles does not match the hinges and frames");
    if (arrays.has(name)) return this.numbers(name);
    const planes = this.numbers("angle_planes"), count = arrays.get("angle_planes")?.shape[1] ?? 0, step = angles.step_rad, now = new Float64Array(J);
    const values = Float64Array.from({ length: count }, (_, k) => { // integers with the sign in the lowest bit
      const code = planes[k] + 256 * (planes[count + k] + 256 * (planes[2 * count + k] + 256 * planes[3 * count + k]));
      return code % 2 ? -(code + 1) / 2 : code / 2;
    });
    if (!this.windowed) {
      for (let d = angles.differences; d > 0; d--) for (let k = J; k < values.length; k++) values[k] += values[k - J];
      return values.map((x) => x * step);
    }
    first.forEach((a, k) => {
      for (let h = a, at = offsets[k]; h < last[k]; h++, at++) values[at] = Math.fround((now[h] += values[at]) * step);
      for (let h = 0; h < J; h++) if (h < a || h >= last[k]) now[h] = h < a ? Math.round(folded[h] / step) : 0; // value on entering the window
    });
    return values;
  }

  /** Return the possible defects of a plan, each with true if the plan is free of it. */
  async facts() {
    const { arrays, told, n, known, size, claim, frames, pad, folded, most, module: { sound, told: geometry } } = this;
    const { certificate: said, start } = told, { apart, rigid_links: rigid, hinges, limit_rad: limit } = geometry, times = this.numbers("time_s");
    const names = Array.from({ length: n - 1 - rigid }, (_, i) => hinges.map((h) => `joint_${i + rigid}${h}`)).flat();
    const count = (apart - 1) * (n - 1), exempt = said.exempt_pairs ?? { apart, count }, digest = told.claim?.angles_sha256;
    return {
      [`the plan is not verified; its verdict is "${said.verdict}"`]: String(said.verdict).startsWith("verified"),
      [`the modules do not have the shape of a ${told.chain.module}`]: !known || JSON.stringify(geometry) === JSON.stringify(known),
      "a size or a direction in the description of the module is invalid": sound,
      "the module size or the clearance is out of range": size > 0 && size <= 1 && claim > 0 && Number.isFinite(claim),
      "the names of the hinges do not match the chain": JSON.stringify(names) === JSON.stringify(arrays.get("joint_names")?.values),
      "the angles are missing, or stored more than once": ["joint_angles_rad", "angles_rad", "angle_planes"].filter((name) => arrays.has(name)).length === 1,
      "the certificate does not cover the same pairs of modules as this check": exempt.apart === apart && exempt.count === count,
      [`a hinge turns by ${degrees(most)}, expected at most ${degrees(limit)}`]: most <= limit + SLIP,
      "the number of frames differs from the certificate": [undefined, null, frames].includes(said.frames),
      "the times do not increase": times.length === frames && rise(times),
      "the first frame is not the start shape": near(this.frame(0).subarray(pad), start ? start.folded_rad : new Float64Array(folded.length)),
      "the last frame is not the folded shape": near(this.frame(frames - 1).subarray(pad), folded),
      // Browsers provide hashes only on https and localhost; the proof itself needs no digest.
      "the checksum of the angles does not match": !digest || !globalThis.crypto?.subtle || digest === await this.digest(),
    };
  }

  /**
   * Return the SHA-256 of the angles as 64-bit floats; for windows, of
   * first and offsets as 64-bit integers, then the angles as 32-bit floats.
   */
  async digest() {
    const { windowed, first, offsets, values } = this;
    const parts = windowed ? [BigInt64Array.from([...first, ...offsets], BigInt), Float32Array.from(values)] : [Float64Array.from(values)];
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", await new Blob(parts).arrayBuffer()));
    return Array.from(hash, (byte) => byte.toString(16).padStart(2, "0")).join("");
  }

  /** Return the angles of a frame, including those of rigid links. @param {number} k */
  frame(k) {
    const { pad, folded, values, first: { [k]: a }, last: { [k]: b }, offsets: { [k]: offset } } = this, found = new Float64Array(pad + folded.length);
    found.set(folded.subarray(0, a), pad);
    found.set(values.subarray(offset, offset + b - a), pad + a);
    return found;
  }
}
