// The motion during one interval of time: poses at its nodes, how far all can go, and which modules may come near.

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {Float64Array[]} Levels boxes about 1, 2, 4, ... neighbours: least and greatest corner, and how far they go, 7 numbers each */
/** @typedef {{ levels: Levels, first: number, last: number, turned: boolean }} Part some modules of the chain that come one after another */

export const U = 2 ** -53;
export const ORDER = 5; // nodes of an interval; odd, so that one of them is its middle
export const MIDDLE = 2;
export const POSE = 12 * ORDER; // a module's centre and axes at all nodes
const ROUNDED = 1 + 1e-9;
const CROWD = 200; // pairs for each moving module from which on an interval is halved unseen

const NODES = Array.from({ length: ORDER }, (_, k) => (1 - Math.cos((2 * k + 1) * Math.PI / (2 * ORDER))) / 2);
/** Of interpolation: what S^p (L + r) is multiplied by. */
export const REMAINDER = 2 / (4 ** ORDER * 120) * ROUNDED;
/** What turns a polynomial's values at the nodes into its Bernstein coefficients. */
export const BERNSTEIN = inverse(NODES.map((t) => [1, 4, 6, 4, 1].map((c, k) => c * t ** k * (1 - t) ** (4 - k))));
const LEBESGUE = 1.001 * Math.max(...Array.from({ length: 20001 }, (_, s) => NODES.reduce(
  (sum, t, a) => sum + Math.abs(NODES.reduce((l, u, b) => (a === b ? l : l * (s / 20000 - u) / (t - u)), 1)), 0)));

/** @param {number[][]} matrix without a pivot of 0 on the way */
function inverse(matrix) {
  const rows = matrix.map((row, i) => row.concat(row.map((_, j) => Number(i === j))));
  for (let c = 0; c < rows.length; c++) {
    const pivot = rows[c] = rows[c].map((x) => x / rows[c][c]);
    rows.forEach((row, r) => { if (r !== c) rows[r] = row.map((x, k) => x - row[c] * pivot[k]); });
  }
  return rows.map((row) => row.slice(rows.length));
}

/** Boxes of two, four, ... of the boxes given. @param {Float64Array} leaves */
function levelsOf(leaves) {
  const levels = [leaves];
  for (let low = leaves; low.length > 7; levels.push(low)) {
    const before = low, last = low.length / 7 - 1;
    low = new Float64Array(7 * ((last >> 1) + 1));
    for (let k = 0; k < low.length; k++) {
      const x = k % 7, a = before[2 * k - x], b = before[7 * Math.min(2 * (k - x) / 7 + 1, last) + x];
      low[k] = x < 3 ? Math.min(a, b) : Math.max(a, b);
    }
  }
  return levels;
}

/** Boxes of poses that stand still, or that turn about where the first begins: these go as far as they are away. @type {(poses: Float64Array, turned: boolean) => Levels} */
function stillBoxes(poses, turned) {
  return levelsOf(new Float64Array(7 * (poses.length / 12)).map((_, k) => {
    const x = k % 7, m = 12 * (k - x) / 7;
    return x < 6 ? poses[m + x % 3] : Number(turned) * Math.hypot(poses[m], poses[m + 1], poses[m + 2]) * ROUNDED;
  }));
}

export class Interval {
  k = 0;
  c = 0; // the last module at rest
  W = 0; // how many move behind it
  slack = 0;
  tailWay = 0;
  swing = 0; // how far the axes of what comes behind turn
  fresh = false; // whether pairs that do not move need a look
  whole = false; // whether all modules move
  most = 0;
  A = new Float64Array(7);
  B = new Float64Array(7);
  /** @type {number[]} */
  found = [];

  /**
   * @param {Plan} plan
   * @param {number} E what rounding may do
   */
  constructor(plan, E) {
    const folded = new Float64Array(plan.slots), straight = new Float64Array(plan.slots);
    folded.set(plan.folded, plan.pad);
    this.plan = plan;
    this.E = E;
    this.shapes = { folded, straight };
    this.core = this.atRest(folded);
    this.straight = this.atRest(straight);
    this.levels = plan.windowed ? { core: stillBoxes(this.core, false), tail: stillBoxes(this.straight.subarray(12), true) } : null;
    this.P = new Float64Array((plan.n + 2) * POSE); // poses of moving modules, then places for two others
    this.S = new Float64Array(plan.n);
    this.turning = new Int32Array(plan.n);
    this.q = this.step = straight;
  }

  /** Poses of a chain that stands still. @param {Float64Array} angles */
  atRest(angles) {
    const { n, module: m } = this.plan, found = Float64Array.from({ length: 12 * n }, (_, x) => Number(x === 3 || x === 7 || x === 11));
    for (let k = 1; k < n; k++) m.next(found, 12 * (k - 1), 12 * k, angles, (k - 1) * m.hinges);
    return found;
  }

  /** Takes up a shape that stands still, as it is in frame k, with all its pairs. @param {Float64Array} angles @param {number} k */
  still(angles, k) {
    Object.assign(this, { k, c: 0, W: this.plan.n - 1, q: angles, step: new Float64Array(angles.length), fresh: true, whole: true });
  }

  /** Takes up the motion between frame k and the next: modules to c are as folded, those behind c + W straight. @param {number} k */
  between(k) {
    const { plan } = this, h = plan.module.hinges, after = Math.min(k + 1, plan.frames - 1), whole = !plan.windowed;
    const c = whole ? 0 : Math.min(Math.floor((Math.min(plan.first[k], plan.first[after]) + plan.pad) / h), plan.n - 2);
    const W = Math.min(Math.max(Math.ceil((Math.max(plan.last[k], plan.last[after]) + plan.pad) / h) - c, 1), plan.n - 1 - c);
    const [q, next] = [k, after].map((frame) => plan.frame(frame, c * h, new Float64Array(W * h)));
    Object.assign(this, { k, c, W, q, step: next.map((x, s) => x - q[s]), fresh: k === 0, whole });
  }

  /** Poses and turning in a share of the time between the two frames: from t on, w long. @param {number} t @param {number} w */
  at(t, w) {
    const { P, S, W, q, step, turning, core, plan: { module: m } } = this, angles = new Float64Array(W * m.hinges), from = this.whole ? 0 : 12 * this.c;
    NODES.forEach((node, a) => {
      for (let x = 0; x < 12; x++) P[12 * a + x] = core[from + x];
      for (let s = 0; s < angles.length; s++) angles[s] = q[s] + (t + w * node) * step[s];
      for (let j = 0; j < W; j++) m.next(P, j * POSE + 12 * a, (j + 1) * POSE + 12 * a, angles, j * m.hinges);
    });
    for (let j = 0, sum = 0, many = 0; j < W; j++) {
      for (let s = j * m.hinges; s < (j + 1) * m.hinges; s++) if (step[s] !== 0) { sum += Math.abs(step[s]) * w; many++; }
      S[j + 1] = sum * ROUNDED;
      turning[j + 1] = many;
    }
    this.slack = 4 * (W * m.hinges + 4) * U * S[W];
  }

  /** Which of the moving modules stands for one that is at rest. @param {number} m */
  clip(m) {
    return Math.min(Math.max(m - this.c, 0), this.W);
  }

  /** How much all hinges between two modules turn, at most. @param {number} i @param {number} j */
  turns(i, j) {
    return this.S[this.clip(j)] - this.S[this.clip(i)] + this.slack;
  }

  /** Where a module's poses stand in P. @param {number} m @param {number} spare which place to use if it does not move */
  pose(m, spare) {
    const { P, W, core, straight } = this, k = m - this.c, start = k >= 0 && k <= W ? k * POSE : (this.plan.n + spare) * POSE;
    for (let to = start; k < 0 && to < start + POSE; to++) P[to] = core[12 * m + (to - start) % 12];
    for (let to = start, last = W * POSE; k > W && to < start + POSE; to += 12, last += 12) for (let x = 0; x < 12; x++) {
      const axis = last + 3 + x % 3, r = 12 * (k - W) + x - x % 3;
      P[to + x] = (x < 3 ? P[last + x] : 0) + straight[r] * P[axis] + straight[r + 1] * P[axis + 3] + straight[r + 2] * P[axis + 6];
    }
    return start;
  }

  /** How far a centre or an axis goes from the middle on: by what is seen at the nodes, or by the hinges between. @type {(seen: number, turn: number, L: number) => number} */
  way(seen, turn, L) {
    return (Math.min(LEBESGUE * seen + REMAINDER * turn ** ORDER * L, .5 * turn * L) + this.E) * ROUNDED;
  }

  /** Boxes about the moving modules, and how far they and what comes behind them go. */
  local() {
    const { P, W, S, slack } = this, root = this.whole ? W >> 1 : 0, leaves = new Float64Array(7 * (W + 1));
    for (let m = 0; m <= W; m++) {
      for (let x = 0; x < 6; x++) leaves[7 * m + x] = P[m * POSE + 12 * MIDDLE + x % 3];
      leaves[7 * m + 6] = this.way(this.seen(root, m, 0), Math.abs(S[m] - S[root]) + slack, Math.abs(m - root) * this.plan.module.link);
    }
    this.swing = this.way(Math.hypot(...[3, 6, 9].map((part) => this.seen(0, W, part))), S[W] + slack, 1);
    return levelsOf(leaves);
  }

  /** How far a centre (part 0) or an axis (3, 6, 9) is from its middle, as seen from a root, at the nodes. @type {(root: number, m: number, part: number) => number} */
  seen(root, m, part) {
    const { P } = this, mid = [0, 0, 0];
    let most = 0;
    for (let k = -1; k < ORDER; k++) {
      const o = 12 * (k < 0 ? MIDDLE : k), from = root * POSE + o, to = m * POSE + o + part;
      const x = P[to] - (part ? 0 : P[from]), y = P[to + 1] - (part ? 0 : P[from + 1]), z = P[to + 2] - (part ? 0 : P[from + 2]);
      let far = 0;
      for (let a = 0; a < 3; a++) {
        const along = P[from + 3 + 3 * a] * x + P[from + 4 + 3 * a] * y + P[from + 5 + 3 * a] * z;
        if (k < 0) mid[a] = along; else far += (along - mid[a]) ** 2;
      }
      most = Math.max(most, far);
    }
    return Math.sqrt(most);
  }

  /** Modules i, j, i, j, ... that may come nearer than `reach` from centre to centre, each i before j; null if they are a crowd. @param {number} reach */
  near(reach) {
    const { c, W, plan: { n } } = this, local = { levels: this.local(), first: c, last: c + W, turned: false };
    /** @type {[Part, Part][]} */
    const sides = [[local, local]];
    if (!this.whole && this.levels) {
      const core = { levels: this.levels.core, first: 0, last: c - 1, turned: false };
      const tail = { levels: this.levels.tail, first: c + W + 1, last: n - 1, turned: true };
      this.tailWay = local.levels[0][7 * W + 6];
      sides.push([core, local], [core, tail], [local, tail]);
    }
    this.found = [];
    this.most = 2 * CROWD * (W + 10);
    for (const [one, two] of sides) this.descend(reach, one, one.levels.length - 1, 0, two, two.levels.length - 1, 0);
    return this.found.length > this.most ? null : this.found;
  }

  /** @type {(reach: number, one: Part, li: number, i: number, two: Part, lj: number, j: number) => void} */
  descend(reach, one, li, i, two, lj, j) {
    const { plan: { module: { told: { apart }, link } }, found, A, B } = this;
    const from = one.first + (i << li), end = Math.min(two.first + ((j + 1) << lj) - 1, two.last);
    if (from > one.last || two.first + (j << lj) > two.last || end - from < apart || found.length > this.most) return;
    if (!this.fresh && this.turning[this.clip(end)] === this.turning[this.clip(from)]) return; // as proved before
    this.box(one, li, i, A);
    this.box(two, lj, j, B);
    let gap = 0;
    for (let x = 0; x < 3; x++) gap += Math.max(A[x] - B[x + 3], B[x] - A[x + 3], 0) ** 2;
    const ways = Math.min(A[6] + B[6], .5 * this.turns(from, end) * (end - from) * link) * ROUNDED;
    if (Math.sqrt(gap) >= reach + ways) return;
    if (!li && !lj) found.push(from, end);
    else if (li >= lj) for (let half = 0; half < 2; half++) this.descend(reach, one, li - 1, 2 * i + half, two, lj, j);
    else for (let half = 0; half < 2; half++) this.descend(reach, one, li, i, two, lj - 1, 2 * j + half);
  }

  /** @type {(part: Part, level: number, i: number, out: Float64Array) => void} */
  box({ levels, turned }, level, i, out) {
    const { P } = this, last = this.W * POSE + 12 * MIDDLE, boxes = levels[level], o = 7 * i;
    for (let x = 0; x < 7; x++) out[x] = boxes[o + x];
    if (!turned) return;
    for (let x = 0; x < 3; x++) {
      let centre = P[last + x], half = 0;
      for (let a = 0; a < 3; a++) {
        const axis = P[last + 3 + 3 * a + x];
        centre += axis * (boxes[o + a] + boxes[o + a + 3]) / 2;
        half += Math.abs(axis) * (boxes[o + a + 3] - boxes[o + a]) / 2;
      }
      out[x] = centre - half;
      out[x + 3] = centre + half;
    }
    out[6] = this.tailWay + out[6] * this.swing;
  }
}
