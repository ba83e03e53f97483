// The motion during one interval of time: poses at its nodes, how far all can go, and which modules may come near.

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {Float64Array[]} Levels boxes about 1, 2, 4, ... neighbours: centre, half size, and how far they go, 7 numbers each */
/** @typedef {{ levels: Levels, first: number, last: number, turned: boolean }} Part some modules of the chain that come one after another */

export const U = 2 ** -53;
export const ORDER = 5; // nodes of an interval; odd, so that one of them is its middle
export const MIDDLE = 2;
export const POSE = 12 * ORDER; // a module's centre and axes at all nodes
export const ROUNDED = 1 + 1e-9;
const CROWD = 200; // pairs for each moving module from which on an interval is halved unseen

const NODES = Array.from({ length: ORDER }, (_, k) => (1 - Math.cos((2 * k + 1) * Math.PI / (2 * ORDER))) / 2);
/** Of interpolation: what S^p (L + r) is multiplied by. */
export const REMAINDER = 2 / (4 ** ORDER * 120) * ROUNDED;
/** What turns a polynomial's values at the nodes into its Bernstein coefficients. */
export const BERNSTEIN = inverse(NODES.map((t) => [1, 4, 6, 4, 1].map((c, k) => c * t ** k * (1 - t) ** (4 - k))));
const LEBESGUE = 1.001 * Math.max(...Array.from({ length: 20001 }, (_, s) => NODES.reduce(
  (sum, t, a) => sum + Math.abs(NODES.reduce((l, u, b) => (a === b ? l : l * (s / 20000 - u) / (t - u)), 1)), 0)));

/** @param {number[][]} matrix */
function inverse(matrix) {
  const rows = matrix.map((row, i) => row.concat(row.map((_, j) => Number(i === j))));
  for (let c = 0; c < rows.length; c++) {
    const at = rows.reduce((best, row, r) => (r > c && Math.abs(row[c]) > Math.abs(rows[best][c]) ? r : best), c);
    [rows[c], rows[at]] = [rows[at], rows[c]];
    const pivot = rows[c] = rows[c].map((x) => x / rows[c][c]);
    rows.forEach((row, r) => { if (r !== c) rows[r] = row.map((x, k) => x - row[c] * pivot[k]); });
  }
  return rows.map((row) => row.slice(rows.length));
}

/** Boxes of two, four, ... of the boxes given. @param {Float64Array} leaves */
function levelsOf(leaves) {
  const levels = [leaves];
  for (let low = leaves; low.length > 7; levels.push(low)) {
    const last = low.length / 7 - 1;
    const next = new Float64Array(7 * ((last >> 1) + 1));
    for (let o = 0; o < next.length; o += 7) {
      const a = 2 * o, b = 7 * Math.min(2 * o / 7 + 1, last);
      for (let x = 0; x < 3; x++) {
        const from = Math.min(low[a + x] - low[a + 3 + x], low[b + x] - low[b + 3 + x]);
        const to = Math.max(low[a + x] + low[a + 3 + x], low[b + x] + low[b + 3 + x]);
        next[o + x] = (from + to) / 2;
        next[o + 3 + x] = (to - from) / 2;
      }
      next[o + 6] = Math.max(low[a + 6], low[b + 6]);
    }
    low = next;
  }
  return levels;
}

/** Boxes of poses that stand still, or that turn about where the first begins: these go as far as they are away. @type {(poses: Float64Array, turned: boolean) => Levels} */
function stillBoxes(poses, turned) {
  const found = new Float64Array(7 * (poses.length / 12));
  for (let m = 0; m < found.length / 7; m++) {
    for (let x = 0; x < 3; x++) found[7 * m + x] = poses[12 * m + x];
    if (turned) found[7 * m + 6] = Math.hypot(found[7 * m], found[7 * m + 1], found[7 * m + 2]) * ROUNDED;
  }
  return levelsOf(found);
}

export class Interval {
  /**
   * @param {Plan} plan
   * @param {number} E what rounding may do
   */
  constructor(plan, E) {
    const { n, module: m } = plan;
    this.plan = plan;
    this.E = E;
    const folded = new Float64Array(plan.slots), straight = new Float64Array(plan.slots);
    folded.set(plan.folded, plan.pad);
    this.shapes = { folded, straight };
    this.core = this.atRest(plan.windowed ? folded : straight);
    this.straight = this.atRest(straight);
    this.levels = plan.windowed ? { core: stillBoxes(this.core, false), tail: stillBoxes(this.straight.subarray(12), true) } : null;
    /** Poses of moving modules, then places for two others. */
    this.P = new Float64Array((n + 2) * POSE);
    this.S = new Float64Array(n);
    this.turning = new Int32Array(n);
    this.angles = new Float64Array(m.hinges);
    this.boxes = [new Float64Array(7), new Float64Array(7)];
    this.q = this.step = straight;
    this.k = this.c = this.W = this.slack = this.swing = this.tailWay = this.most = 0;
    this.fresh = this.whole = false;
    /** @type {number[]} */
    this.found = [];
  }

  /** Poses of a chain that stands still. @param {Float64Array} angles */
  atRest(angles) {
    const { n, module: m } = this.plan;
    const found = Float64Array.from({ length: 12 * n }, (_, x) => Number(x === 3 || x === 7 || x === 11));
    for (let k = 1; k < n; k++) m.next(found, 12 * (k - 1), 12 * k, angles, (k - 1) * m.hinges);
    return found;
  }

  /** Takes up a shape that stands still, as it is in frame k, with all its pairs. @param {Float64Array} angles @param {number} k */
  still(angles, k) {
    this.take(k, 0, angles, new Float64Array(angles.length), true, true);
  }

  /** Takes up the motion between frame k and the next: modules to c are as folded, those behind c + W straight. @param {number} k */
  between(k) {
    const { plan } = this, h = plan.module.hinges, after = Math.min(k + 1, plan.frames - 1);
    const low = plan.windowed ? Math.min(plan.first[k], plan.first[after]) + plan.pad : 0;
    const c = Math.min(Math.floor(low / h), plan.n - 2);
    const joints = Math.ceil((Math.max(plan.last[k], plan.last[after]) + plan.pad) / h) - c;
    const slots = Math.min(Math.max(joints, 1), plan.n - 1 - c) * h;
    const q = plan.frame(k, c * h, new Float64Array(slots)), next = plan.frame(after, c * h, new Float64Array(slots));
    this.take(k, c, q, next.map((x, s) => x - q[s]), k === 0, !plan.windowed);
  }

  /** @type {(k: number, c: number, q: Float64Array, step: Float64Array, fresh: boolean, whole: boolean) => void} */
  take(k, c, q, step, fresh, whole) {
    Object.assign(this, { k, c, W: q.length / this.plan.module.hinges, q, step, fresh, whole });
  }

  /** Poses and turning in a share of the time between the two frames: from t on, w long. @param {number} t @param {number} w */
  at(t, w) {
    const { P, S, W, q, step, angles, turning, plan: { module: m } } = this;
    for (let a = 0; a < ORDER; a++) {
      for (let x = 0; x < 12; x++) P[12 * a + x] = this.whole ? Number(x === 3 || x === 7 || x === 11) : this.core[12 * this.c + x];
      const time = t + w * NODES[a];
      for (let j = 0; j < W; j++) {
        for (let h = 0, s = j * m.hinges; h < m.hinges; h++, s++) angles[h] = q[s] + time * step[s];
        m.next(P, j * POSE + 12 * a, (j + 1) * POSE + 12 * a, angles, 0);
      }
    }
    for (let j = 0, sum = 0, many = 0; j < W; j++) {
      for (let s = j * m.hinges; s < (j + 1) * m.hinges; s++) if (step[s] !== 0) { sum += Math.abs(step[s]) * w; many++; }
      S[j + 1] = sum * ROUNDED;
      turning[j + 1] = many;
    }
    this.slack = 4 * (W * m.hinges + 4) * U * S[W];
  }

  /** @param {number} m */
  clip(m) {
    return Math.min(Math.max(m - this.c, 0), this.W);
  }

  /** How much all hinges between two modules turn, at most. @param {number} i @param {number} j */
  turns(i, j) {
    return this.S[this.clip(j)] - this.S[this.clip(i)] + this.slack;
  }

  /** Where a module's poses stand in P. @param {number} m @param {number} spare which place to use if it does not move */
  pose(m, spare) {
    const { P, W, core, straight } = this, k = m - this.c;
    if (k >= 0 && k <= W) return k * POSE;
    const start = (this.plan.n + spare) * POSE;
    for (let a = 0, to = start; a < ORDER; a++, to += 12) {
      if (k < 0) for (let x = 0; x < 12; x++) P[to + x] = core[12 * m + x];
      else {
        const from = W * POSE + 12 * a, o = 12 * (k - W);
        for (let x = 0; x < 12; x++) {
          const axis = from + 3 + x % 3, r = o + x - x % 3;
          P[to + x] = (x < 3 ? P[from + x] : 0) + straight[r] * P[axis] + straight[r + 1] * P[axis + 3] + straight[r + 2] * P[axis + 6];
        }
      }
    }
    return start;
  }

  /** How far axis or centre goes from the middle on, as seen from a root: the larger of nodes, or by the hinges between. @type {(seen: number, turn: number, L: number) => number} */
  way(seen, turn, L) {
    return (Math.min(LEBESGUE * seen + REMAINDER * turn ** ORDER * L, .5 * turn * L) + this.E) * ROUNDED;
  }

  /** Boxes about the moving modules, and how far they and what comes behind them go. */
  local() {
    const { P, W, S, slack } = this, root = this.whole ? W >> 1 : 0;
    const leaves = new Float64Array(7 * (W + 1));
    for (let m = 0; m <= W; m++) {
      const mid = m * POSE + 12 * MIDDLE;
      for (let x = 0; x < 3; x++) leaves[7 * m + x] = P[mid + x];
      leaves[7 * m + 6] = this.way(this.seen(root, m, 0), Math.abs(S[m] - S[root]) + slack, Math.abs(m - root) * this.plan.module.link);
    }
    if (!this.whole) {
      const turned = [3, 6, 9].map((part) => this.seen(0, W, part));
      this.swing = this.way(Math.hypot(...turned), S[W] + slack, 1);
      this.tailWay = leaves[7 * W + 6];
    }
    return levelsOf(leaves);
  }

  /** How far a centre (part 0) or an axis (3, 6, 9) is from its middle, as seen from a root, at the nodes. @type {(root: number, m: number, part: number) => number} */
  seen(root, m, part) {
    const { P } = this;
    let most = 0, r0 = 0, r1 = 0, r2 = 0;
    for (let k = -1; k < ORDER; k++) {
      const o = 12 * (k < 0 ? MIDDLE : k), from = root * POSE + o, to = m * POSE + o + part;
      const x = P[to] - (part ? 0 : P[from]), y = P[to + 1] - (part ? 0 : P[from + 1]), z = P[to + 2] - (part ? 0 : P[from + 2]);
      const a = P[from + 3] * x + P[from + 4] * y + P[from + 5] * z, b = P[from + 6] * x + P[from + 7] * y + P[from + 8] * z;
      const c = P[from + 9] * x + P[from + 10] * y + P[from + 11] * z;
      if (k < 0) [r0, r1, r2] = [a, b, c];
      else most = Math.max(most, (a - r0) ** 2 + (b - r1) ** 2 + (c - r2) ** 2);
    }
    return Math.sqrt(most);
  }

  /**
   * Modules i, j, i, j, ... that may come nearer than `reach` from centre to centre, each i before j; null if they are a crowd.
   * @param {number} reach
   */
  near(reach) {
    const { c, W, plan: { n } } = this;
    /** @type {Part} */
    const local = { levels: this.local(), first: c, last: c + W, turned: false };
    /** @type {[Part, Part][]} */
    const sides = [[local, local]];
    if (!this.whole && this.levels) {
      const core = { levels: this.levels.core, first: 0, last: c - 1, turned: false };
      const tail = { levels: this.levels.tail, first: c + W + 1, last: n - 1, turned: true };
      sides.push([core, local], [core, tail], [local, tail]);
    }
    this.found = [];
    this.most = 2 * CROWD * (W + 10);
    for (const [one, two] of sides) this.descend(reach, one, one.levels.length - 1, 0, two, two.levels.length - 1, 0);
    return this.found.length > this.most ? null : this.found;
  }

  /** @type {(reach: number, one: Part, li: number, i: number, two: Part, lj: number, j: number) => void} */
  descend(reach, one, li, i, two, lj, j) {
    const { plan: { module: { told: { apart }, link } }, found } = this;
    const from = one.first + (i << li), end = Math.min(two.first + ((j + 1) << lj) - 1, two.last);
    if (from > one.last || two.first + (j << lj) > two.last || end - from < apart || found.length > this.most) return;
    if (!this.fresh && this.turning[this.clip(end)] === this.turning[this.clip(from)]) return; // as proved before
    const [A, B] = this.boxes;
    this.box(one, li, i, A);
    this.box(two, lj, j, B);
    let gap = 0;
    for (let x = 0; x < 3; x++) gap += Math.max(Math.abs(A[x] - B[x]) - A[x + 3] - B[x + 3], 0) ** 2;
    const ways = Math.min(A[6] + B[6], .5 * this.turns(from, end) * (end - from) * link) * ROUNDED;
    if (Math.sqrt(gap) >= reach + ways) return;
    if (!li && !lj) found.push(from, end);
    else if (li >= lj) for (const half of [2 * i, 2 * i + 1]) this.descend(reach, one, li - 1, half, two, lj, j);
    else for (const half of [2 * j, 2 * j + 1]) this.descend(reach, one, li, i, two, lj - 1, half);
  }

  /** @type {(part: Part, level: number, i: number, out: Float64Array) => void} */
  box({ levels, turned }, level, i, out) {
    const boxes = levels[level], { P } = this, last = this.W * POSE + 12 * MIDDLE;
    for (let x = 0; x < 7; x++) out[x] = boxes[7 * i + x];
    if (!turned) return;
    const [a, b, c, p, q, r] = out;
    for (let x = 0; x < 3; x++) {
      const u = P[last + 3 + x], v = P[last + 6 + x], w = P[last + 9 + x];
      out[x] = P[last + x] + a * u + b * v + c * w;
      out[x + 3] = p * Math.abs(u) + q * Math.abs(v) + r * Math.abs(w);
    }
    out[6] = this.tailWay + out[6] * this.swing;
  }
}
