// A convex module at its size, and its joint to the next one: pose' = pose, anchor, hinge turns, a constant turn, offset.

/** @typedef {[number, number, number]} Vector */
/**
 * @typedef {{ corners: Vector[], anchor: Vector, axes: Vector[], turn: Vector[], offset: Vector, rigid_links: number,
 *   apart: number, limit_rad: number, hinges: string[] }} Geometry the product's words for a module
 */

const HALVES = [-.5, .5];
/** @type {Record<string, Geometry>} */
export const KNOWN = {
  cube: {
    corners: HALVES.flatMap((x) => HALVES.flatMap((y) => HALVES.map((z) => /** @type {Vector} */ ([x, y, z])))),
    anchor: [0, 0, 0], axes: [[0, 0, 1], [0, 1, 0]], turn: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset: [1, 0, 0],
    rigid_links: 1, apart: 2, limit_rad: 92 * (Math.PI / 180), hinges: ["_z", "_y"],
  },
  tetrahedron: {
    corners: [[-.5, -1, 0], [-.5, 1, 0], [.5, 0, -1], [.5, 0, 1]],
    anchor: [.5, 0, 0], axes: [[0, 0, 1]], turn: [[1, 0, 0], [0, 0, -1], [0, 1, 0]], offset: [.5, 0, 0],
    rigid_links: 0, apart: 1, limit_rad: 90.85 * (Math.PI / 180), hinges: [""],
  },
};
const SOLID = 1e-9; // shorter vectors, and corners nearer to a plane, count as none and as on it

/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => Vector} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @type {(a: ArrayLike<number>) => number} */
export const norm = (a) => Math.sqrt(dot(a, a));
/** @type {(a: Vector, b: Vector) => Vector} */
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @type {(a: Vector) => Vector} */
const unit = (a) => { const l = norm(a); return [a[0] / l, a[1] / l, a[2] / l]; };

/**
 * Unit vectors without repeats, of opposite ones only one.
 * @param {Vector[]} vectors
 */
function directions(vectors) {
  /** @type {Vector[]} */
  const found = [];
  for (const v of vectors) {
    if (norm(v) > SOLID && !found.some((f) => Math.abs(dot(unit(v), f)) > 1 - SOLID)) found.push(unit(v));
  }
  return found;
}

/**
 * Normals of the faces, and directions of the edges: corners that two faces share.
 * @param {Vector[]} V
 */
function sides(V) {
  /** @type {Map<string, Vector>} */
  const planes = new Map();
  for (let a = 0; a < V.length; a++) for (let b = 0; b < a; b++) for (let c = 0; c < b; c++) {
    const normal = cross(minus(V[a], V[c]), minus(V[b], V[c]));
    const level = V.map((v) => dot(minus(v, V[c]), normal));
    if (norm(normal) <= SOLID || (Math.min(...level) < -SOLID && Math.max(...level) > SOLID)) continue;
    planes.set(level.map((l) => Number(Math.abs(l) < SOLID)).join(""), normal);
  }
  const on = [...planes.keys()];
  const edges = V.flatMap((v, a) => V.slice(0, a).filter((_, b) => on.filter((p) => p[a] === "1" && p[b] === "1").length > 1).map((w) => minus(v, w)));
  return { faces: directions([...planes.values()]), edges: directions(edges) };
}

const axisOf = (/** @type {number} */ k) => [0, 1, 2].map((x) => Number(x === k));

/** Axes of a hinge as columns, the hinge itself the third. @param {Vector} axis */
function frameOf(axis) {
  const most = axis.reduce((a, v, k) => (Math.abs(v) > Math.abs(axis[a]) ? k : a), 0);
  const one = unit(cross(axis, axisOf((most + 2) % 3)));
  return [one, cross(axis, one), axis];
}

export class Module {
  /**
   * @param {Geometry} told
   * @param {number} size
   */
  constructor(told, size) {
    this.told = told;
    this.V = told.corners.map(([x, y, z]) => /** @type {Vector} */ ([x * size, y * size, z * size]));
    this.radius = Math.max(...this.V.map(norm));
    this.half = [0, 1, 2].map((k) => Math.max(...this.V.map((v) => Math.abs(v[k]))));
    this.box = new Set(this.V.map(String)).size === 8 && this.V.length === 8 && this.V.every((v) => v.every((x, k) => Math.abs(x) === this.half[k]));
    this.sides = sides(this.V);
    this.link = (norm(told.anchor) + norm(told.offset)) * (1 + 1e-12);
    this.hinges = told.axes.length;
    const frames = [[0, 1, 2].map(axisOf), ...told.axes.map(frameOf), [0, 1, 2].map((k) => told.turn.map((row) => row[k]))];
    /** Rows of the turns between hinges' frames. */
    this.between = frames.slice(1).map((next, k) => frames[k].map((a) => next.map((b) => dot(a, b))));
    this.plain = this.between.flat(2).every((v) => v === 0 || Math.abs(v) === 1);
  }

  /** Whether the joint turns without stretching, and the corners span a solid. */
  get sound() {
    const { turn, axes, rigid_links: rigid } = this.told;
    if (!Number.isInteger(rigid) || rigid < 0) return false;
    const same = turn.every((a, i) => turn.every((b, j) => Math.abs(dot(a, b) - Number(i === j)) < 8e-15));
    return same && dot(turn[0], cross(turn[1], turn[2])) > 0 && axes.every((a) => Math.abs(norm(a) - 1) < 8e-15) && this.sides.faces.length > 2;
  }

  /** Least of (x, y, z) . corner over the corners. @type {(x: number, y: number, z: number) => number} */
  least(x, y, z) {
    if (this.box) return -(Math.abs(x) * this.half[0] + Math.abs(y) * this.half[1] + Math.abs(z) * this.half[2]);
    let found = Infinity;
    for (const v of this.V) found = Math.min(found, x * v[0] + y * v[1] + z * v[2]);
    return found;
  }

  /**
   * The next module's pose: centre, then three axes, from the one before and the angles of the hinges between.
   * @param {Float64Array} P
   * @param {number} from
   * @param {number} to
   * @param {ArrayLike<number>} q
   * @param {number} at
   */
  next(P, from, to, q, at) {
    const { anchor, offset } = this.told;
    for (let x = 0; x < 12; x++) P[to + x] = P[from + x];
    for (let x = 0; x < 3; x++) P[to + x] += anchor[0] * P[to + 3 + x] + anchor[1] * P[to + 6 + x] + anchor[2] * P[to + 9 + x];
    for (let k = 0; k <= this.hinges; k++) {
      const [r0, r1, r2] = this.between[k];
      const c = k < this.hinges ? Math.cos(q[at + k]) : 1;
      const s = k < this.hinges ? Math.sin(q[at + k]) : 0;
      for (let x = to + 3; x < to + 6; x++) {
        const a = P[x], b = P[x + 3], d = P[x + 6];
        const one = r0[0] * a + r1[0] * b + r2[0] * d, two = r0[1] * a + r1[1] * b + r2[1] * d;
        P[x] = c * one + s * two;
        P[x + 3] = c * two - s * one;
        P[x + 6] = r0[2] * a + r1[2] * b + r2[2] * d;
      }
    }
    for (let x = 0; x < 3; x++) P[to + x] += offset[0] * P[to + 3 + x] + offset[1] * P[to + 6 + x] + offset[2] * P[to + 9 + x];
  }
}
