// Proves that modules stay apart all the time, also between frames. The lemmas and their proofs stand in foldback_check.py;
// names follow it: S bounds how much hinges turn, L is the length of links, E what rounding may do.
import { BERNSTEIN, Interval, MIDDLE, ORDER, POSE, REMAINDER, U } from "./interval.js";
import { Module } from "./module.js";
import { NotProved } from "./plan.js";

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Place} Place */

const DEPTH = 14; // an interval is halved at most so many times
const SHY = 1e-4; // by how much modules are made smaller than those that touch
const PARALLEL = 1e-6; // edges with a shorter cross product give no axis

export class Proof {
  y = new Float64Array(3 * ORDER); // where the second module's centre is, as seen from the first, at the nodes
  M = new Float64Array(9); // the second module's axes there in the middle, as columns
  line = new Float64Array(4 * ORDER);
  best = { gap: 0, fits: 0, x: 0, y: 0, z: 0, ofSecond: false };
  frame = 0;
  looks = 0;
  pairs = 0;
  least = Infinity;
  /** @type {Place | null} the tightest place so far */
  tightest = null;
  /** @type {Place | null} where an interval was left open last */
  open = null;
  /** @type {(Place & { size: number }) | null} which modules made all smaller last, and the size at which they touch */
  touch = null;

  /**
   * @param {Plan} plan
   * @param {{ claim?: number, size?: number, grow?: boolean }} [options] with `grow`, modules become smaller until none touch
   */
  constructor(plan, { claim = plan.claim, size = plan.size, grow = false } = {}) {
    const m = new Module(plan.module.told, size), angle = (4 * 2 + 2) * U * plan.most + 8 * U;
    const e = m.hinges * Math.SQRT2 * (2 * angle + 3 * U) + (m.plain ? 0 : (m.hinges + 1) * 40 * U);
    const scale = Math.max(...BERNSTEIN.map((row) => row.reduce((sum, x) => sum + Math.abs(x), 0)));
    this.E = scale * (m.link * plan.n + 2 * m.radius) * (plan.n * (2 * e + 48 * U) + 256 * U);
    this.plan = plan;
    this.claim = claim;
    this.size = size;
    this.grow = grow;
    this.module = m;
    this.motion = new Interval(plan, this.E);
  }

  /** Proves all intervals; gives each one's frame before it looks at it. */
  * run() {
    const { plan, motion, motion: { shapes } } = this, last = Math.max(1, plan.frames - 1);
    for (let k = plan.windowed ? -2 : 0; k < last; k++) {
      yield Math.max(k, 0);
      if (k >= 0) motion.between(k); else if (k < -1) motion.still(shapes.folded, last); else motion.still(shapes.straight, 0);
      this.look(0, 1, null);
    }
  }

  /**
   * @param {number} t
   * @param {number} w
   * @param {number[] | null} only which modules to look at, if not at all
   */
  look(t, w, only) {
    const { motion } = this;
    motion.at(t, w);
    this.looks++;
    this.frame = motion.k + t + w / 2;
    const found = only ?? motion.near(2 * this.module.radius + this.claim + this.E);
    /** @type {number[]} */
    const left = [];
    for (let p = 0; found && p < found.length; p += 2) if (!this.clear(found[p], found[p + 1])) left.push(found[p], found[p + 1]);
    if (found && !left.length) return;
    if (w <= 2 ** -DEPTH) this.stuck(t, w, left);
    else for (const begin of [t, t + w / 2]) this.look(begin, w / 2, found && left);
  }

  /** Ends the proof where halving does not help; or looks again with smaller modules. @param {number} t @param {number} w @param {number[]} left */
  stuck(t, w, left) {
    const place = left.length ? this.open : null;
    if (!this.grow || !place) throw new NotProved(`No proof around frame ${this.frame.toFixed(6)}.`, place);
    this.fit(place, this.size);
    this.look(t, w, left);
  }

  /** Makes all modules a little smaller than the size at which two touch. @param {Place} place @param {number} size */
  fit(place, size) {
    if (!(size > SHY)) throw new NotProved(`Modules ${place.modules} have one centre at frame ${this.frame.toFixed(6)}.`, place);
    this.touch = { ...place, size };
    this.size = size - SHY;
    this.module = new Module(this.plan.module.told, this.size);
  }

  /** @type {(i: number, j: number) => Place} */
  place(i, j) {
    return { modules: [i, j], frame: this.frame, gap: this.best.gap };
  }

  /** Whether two modules are proved to be far enough apart during the interval. @param {number} i @param {number} j */
  clear(i, j) {
    const { motion: { P }, motion, y } = this;
    const at = motion.pose(i, 0), to = motion.pose(j, 1);
    this.pairs++;
    for (let a = 0, s = 0; a < POSE; a += 12, s += 3) {
      const o = at + a, g0 = P[to + a] - P[o], g1 = P[to + a + 1] - P[o + 1], g2 = P[to + a + 2] - P[o + 2];
      y[s] = P[o + 3] * g0 + P[o + 4] * g1 + P[o + 5] * g2;
      y[s + 1] = P[o + 6] * g0 + P[o + 7] * g1 + P[o + 8] * g2;
      y[s + 2] = P[o + 9] * g0 + P[o + 10] * g1 + P[o + 11] * g2;
    }
    for (;;) {
      const { module: m } = this;
      const lost = REMAINDER * motion.turns(i, j) ** ORDER * ((j - i) * m.link + m.radius) + this.E;
      let bound = this.balls() - 2 * m.radius - lost;
      if (!(bound >= this.claim)) bound = this.solids(i, j, at, to, lost);
      if (bound >= this.claim) {
        this.least = Math.min(this.least, bound);
        return true;
      }
      const place = this.place(i, j);
      if (place.gap >= this.claim) {
        this.open = place;
        return false;
      }
      if (!this.grow) throw new NotProved(`Modules ${i} and ${j}: no gap above ${place.gap.toFixed(9)} was found at frame ${place.frame.toFixed(6)}, less than ${this.claim.toFixed(9)}.`, place);
      this.fit(place, this.best.fits);
    }
  }

  /** Least Bernstein coefficient of how far centres are apart along the line between them in the middle. */
  balls() {
    const { y: Y, line } = this, x = Y[3 * MIDDLE], y = Y[3 * MIDDLE + 1], z = Y[3 * MIDDLE + 2], l = Math.sqrt(x * x + y * y + z * z) || 1;
    for (let a = 0, s = 0; a < ORDER; a++, s += 3) line[a] = (x * Y[s] + y * Y[s + 1] + z * Y[s + 2]) / l;
    let least = Infinity;
    for (const row of BERNSTEIN) least = Math.min(least, this.coefficient(row, 0));
    return least;
  }

  /** Bound along the axis that separates best in the middle: of centres and faces, and if it must be, of edges. @type {(i: number, j: number, at: number, to: number, lost: number) => number} */
  solids(i, j, at, to, lost) {
    const { M, y: Y, best, module: { faces, edges }, motion: { P } } = this, one = at + 12 * MIDDLE + 3, two = to + 12 * MIDDLE + 3;
    for (let k = 0; k < 9; k++) {
      const a = one + k - k % 3, b = two + 3 * (k % 3);
      M[k] = P[a] * P[b] + P[a + 1] * P[b + 1] + P[a + 2] * P[b + 2];
    }
    const x = Y[3 * MIDDLE], y = Y[3 * MIDDLE + 1], z = Y[3 * MIDDLE + 2], l = Math.sqrt(x * x + y * y + z * z) || 1;
    let bound = -Infinity, gap = -Infinity;
    best.fits = -Infinity;
    for (const last of [false, true]) {
      best.gap = -Infinity;
      if (!last) this.along(x / l, y / l, z / l, false);
      if (!last) for (const n of faces) this.along(n[0], n[1], n[2], false);
      for (const n of last ? edges : faces) {
        const u = n[0], v = n[1], w = n[2];
        const a = M[0] * u + M[1] * v + M[2] * w, b = M[3] * u + M[4] * v + M[5] * w, c = M[6] * u + M[7] * v + M[8] * w;
        if (!last) this.along(a, b, c, true);
        else for (const e of edges) {
          const p = e[1] * c - e[2] * b, q = e[2] * a - e[0] * c, r = e[0] * b - e[1] * a, s = Math.sqrt(p * p + q * q + r * r);
          if (s > PARALLEL) this.along(p / s, q / s, r / s, false);
        }
      }
      gap = Math.max(gap, best.gap);
      if (best.gap - lost >= this.claim) bound = Math.max(bound, this.during(at, to) - lost);
      if (bound >= this.claim) break;
    }
    best.gap = gap;
    if (!this.tightest || gap < this.tightest.gap) this.tightest = this.place(i, j);
    return bound;
  }

  /** Tries an axis of the first module: how far it separates the two in the middle, and up to which size. @type {(x: number, y: number, z: number, ofSecond: boolean) => void} */
  along(x, y, z, ofSecond) {
    const { y: Y, M, module: m, best } = this, far = x * Y[3 * MIDDLE] + y * Y[3 * MIDDLE + 1] + z * Y[3 * MIDDLE + 2], sign = far < 0 ? -1 : 1;
    x *= sign;
    y *= sign;
    z *= sign;
    const thick = -m.least(-x, -y, -z) - m.least(M[0] * x + M[3] * y + M[6] * z, M[1] * x + M[4] * y + M[7] * z, M[2] * x + M[5] * y + M[8] * z);
    if (this.grow) best.fits = Math.max(best.fits, this.size * (sign * far - this.claim) / thick);
    if (sign * far - thick <= best.gap) return;
    best.gap = sign * far - thick;
    best.x = x;
    best.y = y;
    best.z = z;
    best.ofSecond = ofSecond;
  }

  /** Bound along the best axis during the whole interval, held still in the module that it belongs to, before what is lost. @type {(at: number, to: number) => number} */
  during(at, to) {
    const { best, M, line, module: m, motion: { P } } = this;
    let { x, y, z } = best;
    if (best.ofSecond) {
      [x, y, z] = [-(M[0] * x + M[3] * y + M[6] * z), -(M[1] * x + M[4] * y + M[7] * z), -(M[2] * x + M[5] * y + M[8] * z)];
      [at, to] = [to, at];
    }
    for (let a = 0, o = at, p = to; a < ORDER; a++, o += 12, p += 12) {
      const u = x * P[o + 3] + y * P[o + 6] + z * P[o + 9], v = x * P[o + 4] + y * P[o + 7] + z * P[o + 10], w = x * P[o + 5] + y * P[o + 8] + z * P[o + 11];
      line[a] = u * (P[p] - P[o]) + v * (P[p + 1] - P[o + 1]) + w * (P[p + 2] - P[o + 2]);
      for (let s = 1; s < 4; s++) line[s * ORDER + a] = u * P[p + 3 * s] + v * P[p + 3 * s + 1] + w * P[p + 3 * s + 2];
    }
    let least = Infinity;
    for (const row of BERNSTEIN) least = Math.min(least, this.coefficient(row, 0) + m.least(this.coefficient(row, 1), this.coefficient(row, 2), this.coefficient(row, 3)));
    return least + m.least(-x, -y, -z);
  }

  /** One Bernstein coefficient of one of the polynomials in `line`. @param {number[]} row @param {number} which */
  coefficient(row, which) {
    const { line } = this, o = which * ORDER;
    return row[0] * line[o] + row[1] * line[o + 1] + row[2] * line[o + 2] + row[3] * line[o + 3] + row[4] * line[o + 4];
  }
}
