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
  /**
   * @param {Plan} plan
   * @param {{ claim?: number, size?: number, grow?: boolean }} [options] with `grow`, modules become smaller until none touch
   */
  constructor(plan, { claim = plan.claim, size = plan.size, grow = false } = {}) {
    const { n } = plan, m = new Module(plan.module.told, size), h = m.hinges;
    const a = 4 * U * 2 * plan.most + 2 * U * plan.most + 4 * U;
    const e = h * Math.SQRT2 * (2 * a + 3 * U) + (m.plain ? 0 : (h + 1) * 15 * U);
    const scale = Math.max(...BERNSTEIN.map((row) => row.reduce((sum, x) => sum + Math.abs(x), 0)));
    this.plan = plan;
    this.claim = claim;
    this.size = size;
    this.grow = grow;
    this.module = m;
    this.E = scale * (m.link * n + 2 * m.radius) * (n * (2 * e + 48 * U) + 256 * U);
    this.motion = new Interval(plan, this.E);
    this.y = new Float64Array(3 * ORDER);
    this.M = new Float64Array(9);
    this.line = new Float64Array(4 * ORDER);
    this.best = { gap: 0, fits: 0, x: 0, y: 0, z: 0, ofSecond: false };
    this.frame = this.looks = this.pairs = 0;
    this.least = Infinity;
    /** @type {Place | null} the tightest place so far */
    this.tightest = null;
    /** @type {(Place & { size: number }) | null} which modules made all smaller last, and the size at which they touch */
    this.touch = null;
  }

  /** Proves all intervals; gives each one's frame before it looks at it. */
  * run() {
    const { plan, motion } = this, last = Math.max(1, plan.frames - 1);
    if (plan.windowed) {
      yield 0;
      motion.still(motion.shapes.folded, last);
      this.look(0, 1, null);
      yield 0;
      motion.still(motion.shapes.straight, 0);
      this.look(0, 1, null);
    }
    for (let k = 0; k < last; k++) {
      yield k;
      motion.between(k);
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
    const place = left.length ? this.place(left[0], left[1]) : null;
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
      if (this.best.gap >= this.claim) return false;
      const place = this.place(i, j);
      if (!this.grow) throw new NotProved(`Modules ${i} and ${j} are ${place.gap.toFixed(9)} apart at frame ${place.frame.toFixed(6)}, less than ${this.claim.toFixed(9)}.`, place);
      this.fit(place, this.best.fits);
    }
  }

  /** Least Bernstein coefficient of how far centres are apart along the line between them in the middle. */
  balls() {
    const { y, line } = this, n0 = y[3 * MIDDLE], n1 = y[3 * MIDDLE + 1], n2 = y[3 * MIDDLE + 2];
    const l = Math.sqrt(n0 * n0 + n1 * n1 + n2 * n2) || 1;
    for (let a = 0; a < ORDER; a++) line[a] = (n0 * y[3 * a] + n1 * y[3 * a + 1] + n2 * y[3 * a + 2]) / l;
    let least = Infinity;
    for (const row of BERNSTEIN) least = Math.min(least, row[0] * line[0] + row[1] * line[1] + row[2] * line[2] + row[3] * line[3] + row[4] * line[4]);
    return least;
  }

  /** Bound along the axis that separates best in the middle: of centres and faces, and if it must be, of edges. @type {(i: number, j: number, at: number, to: number, lost: number) => number} */
  solids(i, j, at, to, lost) {
    const { M, y, best, module: m, motion: { P } } = this, one = at + 12 * MIDDLE + 3, two = to + 12 * MIDDLE + 3, mid = 3 * MIDDLE;
    for (let a = 0; a < 3; a++) for (let b = 0; b < 3; b++) {
      M[3 * a + b] = P[one + 3 * a] * P[two + 3 * b] + P[one + 3 * a + 1] * P[two + 3 * b + 1] + P[one + 3 * a + 2] * P[two + 3 * b + 2];
    }
    const l = Math.sqrt(y[mid] ** 2 + y[mid + 1] ** 2 + y[mid + 2] ** 2) || 1;
    best.gap = best.fits = -Infinity;
    this.along(y[mid] / l, y[mid + 1] / l, y[mid + 2] / l, false);
    for (const [x, y1, z] of m.faces) this.along(x, y1, z, false);
    for (const [x, y1, z] of m.faces) this.along(M[0] * x + M[1] * y1 + M[2] * z, M[3] * x + M[4] * y1 + M[5] * z, M[6] * x + M[7] * y1 + M[8] * z, true);
    let bound = best.gap - lost >= this.claim ? this.during(at, to) : -Infinity;
    if (!(bound >= this.claim)) {
      const { gap } = best;
      best.gap = -Infinity;
      for (const [x, y1, z] of m.edges) {
        const a = M[0] * x + M[1] * y1 + M[2] * z, b = M[3] * x + M[4] * y1 + M[5] * z, c = M[6] * x + M[7] * y1 + M[8] * z;
        for (const [u, v, w] of m.edges) {
          const p = v * c - w * b, q = w * a - u * c, r = u * b - v * a, s = Math.sqrt(p * p + q * q + r * r);
          if (s > PARALLEL) this.along(p / s, q / s, r / s, false);
        }
      }
      if (best.gap - lost >= this.claim) bound = Math.max(bound, this.during(at, to));
      best.gap = Math.max(best.gap, gap);
    }
    if (!this.tightest || best.gap < this.tightest.gap) this.tightest = this.place(i, j);
    return bound;
  }

  /** Tries an axis of the first module: how far it separates the two in the middle, and up to which size. @type {(x: number, y: number, z: number, ofSecond: boolean) => void} */
  along(x, y, z, ofSecond) {
    const { y: Y, M, module: m, best } = this;
    let far = x * Y[3 * MIDDLE] + y * Y[3 * MIDDLE + 1] + z * Y[3 * MIDDLE + 2];
    if (far < 0) { x = -x; y = -y; z = -z; far = -far; }
    const thick = -m.least(-x, -y, -z) - m.least(M[0] * x + M[3] * y + M[6] * z, M[1] * x + M[4] * y + M[7] * z, M[2] * x + M[5] * y + M[8] * z);
    if (this.grow) best.fits = Math.max(best.fits, this.size * (far - this.claim) / thick);
    if (far - thick <= best.gap) return;
    best.gap = far - thick;
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
    for (let a = 0; a < ORDER; a++) {
      const o = at + 12 * a, p = to + 12 * a;
      const u = x * P[o + 3] + y * P[o + 6] + z * P[o + 9], v = x * P[o + 4] + y * P[o + 7] + z * P[o + 10], w = x * P[o + 5] + y * P[o + 8] + z * P[o + 11];
      line[a] = u * (P[p] - P[o]) + v * (P[p + 1] - P[o + 1]) + w * (P[p + 2] - P[o + 2]);
      for (let s = 1; s < 4; s++) line[s * ORDER + a] = u * P[p + 3 * s] + v * P[p + 3 * s + 1] + w * P[p + 3 * s + 2];
    }
    let least = Infinity;
    for (const row of BERNSTEIN) {
      let far = 0, p = 0, q = 0, r = 0;
      for (let a = 0; a < ORDER; a++) {
        far += row[a] * line[a];
        p += row[a] * line[ORDER + a];
        q += row[a] * line[2 * ORDER + a];
        r += row[a] * line[3 * ORDER + a];
      }
      least = Math.min(least, far + m.least(p, q, r));
    }
    return least + m.least(-x, -y, -z);
  }
}
