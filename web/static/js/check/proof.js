// Proves that modules keep their clearance continuously, including between frames.
// foldback_check.py has the lemmas and their proofs; the names follow it: S bounds the rotation of
// hinges, L is the length of links, E the rounding error.
import { cross, dot, Module, norm, orthonormalise } from "./module.js";
import { NotProved } from "./plan.js";

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Place} Place */
/** @typedef {import("./module.js").Part} Part */
/** @typedef {import("./module.js").Vector} Vector */

const U = 2 ** -53;
const ORDER = 5,
  MIDDLE = 2; // nodes of an interval; odd, so that one of them is the midpoint
const NODES = Array.from(
  { length: ORDER },
  (_, k) => (1 - Math.cos(((2 * k + 1) * Math.PI) / (2 * ORDER))) / 2,
);
const CHOOSE = [[1], [1, 1], [1, 2, 1], [1, 3, 3, 1], [1, 4, 6, 4, 1]];
/** Lagrange polynomials of the nodes: coefficients of 1, t, t^2, ... */
const LAGRANGE = NODES.map((t) =>
  NODES.filter((u) => u !== t).reduce(
    (p, u) => [...p, 0].map((c, k) => ((p[k - 1] ?? 0) - u * c) / (t - u)),
    [1],
  ),
);
/** Matrix from a polynomial's values at the nodes to its Bernstein coefficients. */
const BERNSTEIN = CHOOSE.map((row) =>
  LAGRANGE.map((p) => row.reduce((sum, c, k) => sum + (c / CHOOSE[4][k]) * p[k], 0)),
);
/** Factor of S^p (L + r) in the interpolation error. */
const REMAINDER = (2 / (4 ** ORDER * 120)) * (1 + 1e-9);
const POSES = 12 * ORDER; // a module's centre and axes at all nodes
// Pairs per moving module above which an interval is halved without checking them.
const CROWD = 200;
const DEPTH = 14; // maximum number of halvings of an interval
const PARALLEL = 1e-6; // edges with a shorter cross product give no axis

/** @type {(i: number, j: number) => string} two modules for people, who count from 1 */
const pair = (i, j) => `modules ${i + 1} and ${j + 1}`;
/** Return the largest power of two up to a number, at least 1. @param {number} x */
const powerIn = (x) => 1 << (31 - Math.clz32(Math.max(x, 1)));

/**
 * Return a coefficient of the polynomial through values o, o + 12, o + 24, ...
 * @type {(row: number[], values: Float64Array, o: number) => number}
 */
const coefficient = (row, values, o) =>
  row[0] * values[o] +
  row[1] * values[o + 12] +
  row[2] * values[o + 24] +
  row[3] * values[o + 36] +
  row[4] * values[o + 48];

/**
 * Write the first numbers of a pose seen from another one.
 * @type {(P: Float64Array, from: number, to: number, M: Float64Array, a: number, count?: number) =>
 *   void}
 */
function seen(P, from, to, M, a, count = 12) {
  for (let k = 0; k < count; k += 3) {
    const x = P[to + k] - (k ? 0 : P[from]),
      y = P[to + k + 1] - (k ? 0 : P[from + 1]),
      z = P[to + k + 2] - (k ? 0 : P[from + 2]);
    for (let r = 0; r < 3; r++)
      M[a + k + r] = P[from + 3 + 3 * r] * x + P[from + 4 + 3 * r] * y + P[from + 5 + 3 * r] * z;
  }
}

/**
 * Return the bound of rounding errors: ROUNDING in foldback_check.py.
 * @param {Plan} plan
 * @param {Module} m
 */
function roundingBound({ n, pad, folded, first, last, maxAngle, frames, windowed }, m) {
  const angle = (4 * 2 + 2) * U * maxAngle + 8 * U,
    e = m.hinges * Math.SQRT2 * (2 * angle + 3 * U) + (m.exact ? 0 : (m.hinges + 1) * 40 * U),
    link = (2 + Number(windowed && !m.isStraightExact)) * (e + 24 * U),
    size = m.length * n + 2 * m.radius,
    rows = BERNSTEIN.map((row) => row.reduce((sum, x) => sum + Math.abs(x), 0)),
    scale = Math.max(...rows) * (1 + 1e-6),
    chain = scale * size * (n * link + 256 * U);
  if (!m.isStraightExact) return chain;
  const pose = Float64Array.from({ length: 24 }, (_, x) => Number(x < 12 && x % 4 === 3)),
    angles = new Float64Array(pad + folded.length),
    low = [0, 0, 0],
    high = [0, 0, 0];
  angles.set(folded, pad);
  for (let j = 0; j < n - 1; j++) {
    m.next(pose, 0, 12, angles, j);
    pose.copyWithin(0, 12);
    for (let x = 0; x < 3; x++) {
      low[x] = Math.min(low[x], pose[x]);
      high[x] = Math.max(high[x], pose[x]);
    }
  }
  let widest = 0;
  for (let k = 0; k < frames; k++) {
    const after = Math.min(k + 1, frames - 1);
    widest = Math.max(
      widest,
      Math.ceil((Math.max(last[k], last[after]) + pad) / m.hinges) -
        Math.floor((Math.min(first[k], first[after]) + pad) / m.hinges),
    );
  }
  const D = m.length + Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]),
    moved = n * (D + 2 * m.radius) + (2 * widest + 1) * (size + D);
  return Math.min(chain, scale * (moved * link + (size + D) * 256 * U));
}

export class Proof {
  M = new Float64Array(POSES); // poses of one module relative to another
  line = new Float64Array(POSES); // the same along an axis
  tail = new Float64Array(12); // pose of a module of the straight tail, seen from its first one
  /** @type {Part[][]} parts of these two modules */
  bodies = [];
  /**
   * @type {{ gap: number, axis: Vector, fits: number }} best separating axis, and largest module
   *   size that any axis separates
   */
  best = { gap: 0, axis: [0, 0, 0], fits: 0 };
  /** @type {Place | null} the tightest place so far */
  tightest = null;

  /**
   * @param {Plan} plan
   * @param {number} [size] of modules
   */
  constructor(plan, size = plan.size) {
    const m = new Module(plan.module.geometry, size),
      still = new Float64Array(plan.n * m.hinges);
    this.E = roundingBound(plan, m);
    this.plan = plan;
    this.module = m;
    this.size = size;
    /**
     * The interval begins at frame k; modules up to c are folded, those after
     * `end` straight; P and boxes hold the folded state up to module `folded`.
     */
    this.k = this.frame = this.c = this.end = this.folded = this.slack = this.largest = 0;
    this.P = Float64Array.from({ length: plan.n * POSES }, (_, x) =>
      Number(x < POSES && x % 4 === 3),
    );
    this.S = new Float64Array(plan.n);
    this.straight = this.P.slice(0, 12 * plan.n).fill(0, 12); // poses of the straight chain
    for (let k = 1; k < plan.n; k++) m.next(this.straight, 12 * k - 12, 12 * k, still, k - 1);
    // For each module, the first one after a turning joint.
    this.behind = new Int32Array(plan.n).fill(plan.n);
    this.boxes = new Float64Array(6 * plan.n); // bounds of the centres: minimum and maximum corner
    this.q = this.step = new Float64Array();
  }

  /** Prove all intervals; yield the frame of each one before checking it. */
  *run() {
    for (let k = 0; k < this.intervals; k++) {
      yield k;
      this.interval(k);
    }
    if (this.largest > this.plan.step)
      throw new NotProved(
        `a hinge turns by ${this.largest.toFixed(6)} rad between two frames, more than the plan ` +
          `states.`,
      );
  }

  get intervals() {
    return Math.max(1, this.plan.frames - 1);
  }

  /** Prove the interval from frame k to the next one. @param {number} k */
  interval(k) {
    const {
        plan,
        module: { hinges },
      } = this,
      { first, last, pad, n } = plan,
      after = Math.min(k + 1, plan.frames - 1);
    this.k = k;
    this.q = plan.frame(k);
    this.step = plan.frame(after).map((x, s) => x - this.q[s]);
    this.largest = this.step.reduce((largest, x) => Math.max(largest, Math.abs(x)), this.largest);
    this.c = Math.min(Math.floor((Math.min(first[k], first[after]) + pad) / hinges), n - 2);
    this.end = Math.min(
      Math.max(Math.ceil((Math.max(last[k], last[after]) + pad) / hinges), this.c + 1),
      n - 1,
    );
    this.look(0, 1, null);
  }

  /**
   * Check a fraction of the time between two frames,
   * from t to t + w; bisect it if pairs remain unproved.
   * @param {number} t
   * @param {number} w
   * @param {[number, number][] | null} only pairs of modules to check; null for all
   */
  look(t, w, only) {
    this.move(t, w);
    this.frame = this.k + t + w / 2;
    const unproved = (only ?? this.near())?.filter(([i, j]) => !this.clear(i, j)) ?? null;
    if (unproved?.length === 0) return;
    const open = unproved && {
      modules: unproved[0],
      frame: this.frame,
      gap: this.plan.claim,
      fits: this.size,
    };
    if (w <= 2 ** -DEPTH)
      throw new NotProved(
        `no bound${unproved ? ` between ${pair(...unproved[0])}` : ""} at frame ` +
          `${(this.k + t + 1).toFixed(5)}.`,
        open,
      );
    for (const start of [t, t + w / 2]) this.look(start, w / 2, unproved);
  }

  /**
   * Compute poses at the nodes, up to the straight tail, and the bounds S of rotation.
   * @param {number} t
   * @param {number} w
   */
  move(t, w) {
    const {
        P,
        S,
        c,
        end,
        q,
        step,
        behind,
        module,
        plan: { n },
      } = this,
      { hinges } = module,
      angles = q.slice();
    for (let a = 0; a < POSES; a += 12) {
      for (let s = c * hinges; s < end * hinges; s++)
        angles[s] = q[s] + (t + w * NODES[a / 12]) * step[s];
      for (let j = Math.min(c, this.folded); j < end; j++) {
        module.next(P, j * POSES + a, (j + 1) * POSES + a, angles, j);
        if (j < c) orthonormalise(P, (j + 1) * POSES + a);
      }
    }
    for (let m = n - 2, all = 0; m >= 0; m--) {
      let turn = 0;
      for (let s = m * hinges; s < (m + 1) * hinges; s++) turn += Math.abs(step[s]);
      S[m] = (all += turn * w) * (1 + 1e-9);
      behind[m] = turn > 0 ? m + 1 : behind[m + 1];
    }
    this.slack = 4 * (n * hinges + 4) * U * S[0];
  }

  /** Compute the poses of a module of the straight tail. @param {number} m */
  place(m) {
    const { P, straight, tail, end } = this;
    seen(straight, 12 * end, 12 * m, tail, 0);
    for (let a = end * POSES, p = m * POSES; p < (m + 1) * POSES; a += 12)
      for (let k = 0; k < 12; k += 3) {
        for (let o = a; o < a + 3; o++, p++)
          P[p] =
            (k ? 0 : P[o]) + tail[k] * P[o + 3] + tail[k + 1] * P[o + 6] + tail[k + 2] * P[o + 9];
      }
  }

  /**
   * Return the bound of interpolation and rounding errors for a
   * point of module j at distance r from its centre, relative to i.
   * @type {(i: number, j: number, r: number) => number}
   */
  lost(i, j, r) {
    return (
      REMAINDER *
        (Math.abs(this.S[j] - this.S[i]) + this.slack) ** ORDER *
        (Math.abs(j - i) * this.module.length + r) +
      this.E
    );
  }

  /**
   * Compute the poses of module j relative to i, or only their centres.
   * @param {number} i
   * @param {number} j
   */
  see(i, j, count = 12) {
    const { P, M } = this;
    for (const m of [i, j]) if (m > this.end) this.place(m);
    for (let a = 0; a < POSES; a += 12) seen(P, i * POSES + a, j * POSES + a, M, a, count);
  }

  /** Compute the box that bounds a module's centre, relative to a root module. @param {number} m */
  box(m) {
    const {
        boxes,
        plan: { n, windowed },
      } = this,
      root = windowed ? 0 : n >> 1,
      lost = this.lost(root, m, 0);
    this.see(root, m, 3);
    for (let x = 0; x < 3; x++) {
      const hull = BERNSTEIN.map((row) => coefficient(row, this.M, x));
      boxes[6 * m + x] = Math.min(...hull) - lost;
      boxes[6 * m + 3 + x] = Math.max(...hull) + lost;
    }
  }

  /** Return the pairs i < j of modules that may come too near; null if there are too many. */
  near() {
    const {
      boxes,
      k,
      c,
      end,
      behind,
      folded,
      module: {
        radius,
        length,
        geometry: { apart },
      },
      plan: { n, claim, windowed },
    } = this;
    const pairs = /** @type {[number, number][]} */ ([]),
      reach = 2 * radius + claim + this.E;
    // Boxes of the folded core do not change; those of the straight tail are computed on demand.
    for (let m = windowed ? Math.min(c, folded) : 0; m <= end; m++) this.box(m);
    boxes.fill(NaN, 6 * end + 6);
    this.folded = c;
    for (
      let i = 0, slack = Infinity;
      i < n;
      i += Math.max(Math.floor(slack), 1), slack = Infinity
    ) {
      // Pairs without a turning joint between them do not change. No link is longer than `length`:
      // half of the spare distance is reserved for modules after j, half for those after i.
      for (let j = Math.max(i + apart, k ? behind[i] : 0); j < n;) {
        let gap = 0;
        for (const m of [i, j]) if (Number.isNaN(boxes[6 * m])) this.box(m);
        for (let x = 0; x < 3; x++)
          gap +=
            Math.max(
              boxes[6 * i + x] - boxes[6 * j + x + 3],
              boxes[6 * j + x] - boxes[6 * i + x + 3],
              0,
            ) ** 2;
        const spare = (Math.sqrt(gap) - reach) / length / 2;
        if (!(spare >= 0)) pairs.push([i, j]);
        slack = Math.min(slack, spare);
        // Stop at multiples of powers of two, so that many i share the boxes of distant modules.
        const leap = Math.max(Math.floor(spare), 1) || 1;
        j += leap - ((j + leap) % powerIn(leap / 2));
      }
      if (pairs.length > CROWD * ((k ? end - c : n) + 10)) return null;
    }
    return pairs;
  }

  /**
   * Return true if the clearance of two modules is proved for the interval.
   * @param {number} i
   * @param {number} j
   */
  clear(i, j) {
    this.see(i, j);
    this.bodies = [this.module.piece(i), this.module.piece(j)];
    const {
        frame,
        plan: { claim },
      } = this,
      bound = this.solids(this.lost(i, j, this.module.radius)),
      { gap, fits } = this.best;
    const place = /** @type {Place} */ ({ modules: [i, j], frame, gap, fits });
    if (!this.tightest || gap < this.tightest.gap) this.tightest = place;
    if (!(bound >= claim || gap >= claim))
      throw new NotProved(
        `${pair(i, j)}: no gap above ${gap.toFixed(9)} at frame ${(frame + 1).toFixed(5)}.`,
        place,
      );
    return bound >= claim;
  }

  /** Return the bound for the nearest parts of two modules. @param {number} lost */
  solids(lost) {
    let bound = Infinity,
      gap = Infinity,
      fits = Infinity;
    for (const one of this.bodies[0])
      for (const other of this.bodies[1]) {
        bound = Math.min(bound, this.apart(one, other, lost));
        gap = Math.min(gap, this.best.gap);
        fits = Math.min(fits, this.best.fits);
      }
    this.best = { ...this.best, gap, fits };
    return bound;
  }

  /**
   * Return the bound along the best axis at the midpoint,
   * among centres and faces and, if necessary, edges.
   * @type {(one: Part, other: Part, lost: number) => number}
   */
  apart(one, other, lost) {
    this.best = { gap: -Infinity, axis: [0, 0, 0], fits: -Infinity };
    this.separate(one, other, false);
    const bound = this.during(one, other) - lost;
    if (bound >= this.plan.claim) return bound;
    this.separate(one, other, true);
    return Math.max(bound, this.during(one, other) - lost);
  }

  /**
   * Find the best separating axis at the midpoint: the line
   * of centres, a face normal, or the normal of two edges.
   * @type {(one: Part, other: Part, edges: boolean) => void}
   */
  separate(one, other, edges) {
    const {
        M,
        size,
        plan: { claim },
      } = this,
      axes = edges ? one.edges : one.faces;
    /** @type {Vector[]} */
    const [y, a, b, c] = [0, 3, 6, 9].map((k) => [
      M[12 * MIDDLE + k],
      M[12 * MIDDLE + k + 1],
      M[12 * MIDDLE + k + 2],
    ]);
    const turned = (/** @type {Vector} */ [u, v, w]) =>
        /** @type {Vector} */ ([
          u * a[0] + v * b[0] + w * c[0],
          u * a[1] + v * b[1] + w * c[1],
          u * a[2] + v * b[2] + w * c[2],
        ]),
      turnedAxes = (edges ? other.edges : other.faces).map(turned),
      middle = turned(other.centre).map((x, k) => x + y[k] - one.centre[k]),
      centres = /** @type {Vector} */ (middle);
    for (const axis of edges
      ? axes.flatMap((e) => turnedAxes.map((f) => cross(e, f)))
      : [centres, ...axes, ...turnedAxes]) {
      const far = dot(axis, y),
        l = norm(axis) * (dot(axis, centres) < 0 ? -1 : 1);
      if (Math.abs(l) <= PARALLEL) continue;
      /** @type {Vector} */
      const n = [axis[0] / l, axis[1] / l, axis[2] / l],
        thick = -one.least(-n[0], -n[1], -n[2]) - other.least(dot(a, n), dot(b, n), dot(c, n)),
        free = far / l - claim;
      // Parts beside the centres may lie behind one another: then they come nearer if they shrink.
      const fits = thick > 0 ? (size * free) / thick : free < 0 ? -Infinity : Infinity;
      this.best.fits = Math.max(this.best.fits, fits);
      if (far / l - thick > this.best.gap)
        this.best = { gap: far / l - thick, axis: n, fits: this.best.fits };
    }
  }

  /**
   * Return the bound along the best axis over the whole interval, without the error terms.
   * @type {(one: Part, other: Part) => number}
   */
  during(one, other) {
    const {
      M,
      line,
      best: {
        axis: [x, y, z],
      },
    } = this;
    for (let o = 0; o < POSES; o += 3) line[o] = x * M[o] + y * M[o + 1] + z * M[o + 2];
    let lowest = Infinity;
    for (const row of BERNSTEIN) {
      const far = coefficient(row, line, 0),
        u = coefficient(row, line, 3),
        v = coefficient(row, line, 6),
        w = coefficient(row, line, 9);
      lowest = Math.min(lowest, far + other.least(u, v, w));
    }
    return lowest + one.least(-x, -y, -z);
  }
}
