// A convex module, scaled to its size, and its joint to the next
// one: anchor, turn, hinge about the third axis, turn, ..., offset.

/** @typedef {[number, number, number]} Vector */
/**
 * @typedef {{ corners: Vector[], faces: Vector[], edges: Vector[], anchor: Vector, offset: Vector,
 *   turns: Vector[][],
 *   hinges: string[], rigid_links: number, apart: number, limit_rad: number }} Geometry a plan's
 *   description of a module
 */

const HALVES = [-0.5, 0.5],
  H = Math.SQRT1_2,
  T = Math.sqrt(1 / 3);
/** @type {Vector[]} */
const ONE = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];
/** @type {Record<string, Geometry>} */
export const KNOWN = {
  cube: {
    corners: HALVES.flatMap((x) =>
      HALVES.flatMap((y) => HALVES.map((z) => /** @type {Vector} */ ([x, y, z]))),
    ),
    faces: ONE,
    edges: ONE,
    anchor: [0, 0, 0],
    offset: [1, 0, 0],
    turns: [ONE, [ONE[1], ONE[2], ONE[0]], [ONE[2], ONE[0], ONE[1]]],
    hinges: ["_z", "_y"],
    rigid_links: 1,
    apart: 2,
    limit_rad: 92 * (Math.PI / 180),
  },
  tetrahedron: {
    corners: [
      [-0.5, -1, 0],
      [-0.5, 1, 0],
      [0.5, 0, -1],
      [0.5, 0, 1],
    ],
    faces: [
      [-H, 0, H],
      [-H, 0, -H],
      [H, H, 0],
      [H, -H, 0],
    ],
    edges: [ONE[1], ONE[2], [T, -T, -T], [T, -T, T], [T, T, -T], [T, T, T]],
    anchor: [0.5, 0, 0],
    offset: [0.5, 0, 0],
    turns: [
      ONE,
      [
        [1, 0, 0],
        [0, 0, -1],
        [0, 1, 0],
      ],
    ],
    hinges: [""],
    rigid_links: 0,
    apart: 1,
    limit_rad: 90.85 * (Math.PI / 180),
  },
};

/** @type {(a: Vector, b: Vector) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @type {(a: Vector, b: Vector) => Vector} */
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
/** @type {(a: Vector) => number} */
export const norm = (a) => Math.sqrt(dot(a, a));

export class Module {
  /**
   * @param {Geometry} geometry
   * @param {number} size
   */
  constructor(geometry, size) {
    this.geometry = geometry;
    this.corners = geometry.corners.map(
      ([x, y, z]) => /** @type {Vector} */ ([x * size, y * size, z * size]),
    );
    this.radius = Math.max(...this.corners.map(norm));
    this.length = (norm(geometry.anchor) + norm(geometry.offset)) * (1 + 1e-12);
    this.hinges = geometry.hinges.length;
    this.exact = geometry.turns.flat(2).every((v) => v === 0 || Math.abs(v) === 1);
    this.isStraightExact =
      this.exact && [...geometry.anchor, ...geometry.offset].every((v) => Number.isInteger(2 * v));
  }

  /**
   * True if the turns are rotations, the face normals have
   * length 1, and all other numbers are in their ranges.
   */
  get sound() {
    const { turns, faces, edges, corners, anchor, offset, limit_rad: limit } = this.geometry;
    return (
      turns.every(
        (rows) =>
          dot(rows[0], cross(rows[1], rows[2])) > 0 &&
          rows.every((a, i) => rows.every((b, j) => Math.abs(dot(a, b) - Number(i === j)) < 1e-15)),
      ) &&
      faces.every((f) => Math.abs(dot(f, f) - 1) < 1e-15) &&
      this.length > 1e-6 &&
      limit > 0 &&
      limit <= 2 * Math.PI &&
      [...corners, ...edges, anchor, offset].every((v) => v.every((x) => Math.abs(x) < 1e6))
    );
  }

  /**
   * Return the minimum of (x, y, z) · corner over the corners.
   * @type {(x: number, y: number, z: number) => number}
   */
  least(x, y, z) {
    let lowest = Infinity;
    for (const v of this.corners) lowest = Math.min(lowest, x * v[0] + y * v[1] + z * v[2]);
    return lowest;
  }

  /**
   * Write the next module's pose (centre, then three axes),
   * given the one before and the hinge angles between them.
   * @type {(P: Float64Array, from: number, to: number, q: Float64Array, at: number) => void}
   */
  next(P, from, to, q, at) {
    const { anchor, offset, turns } = this.geometry;
    for (let x = 0; x < 12; x++) P[to + x] = P[from + x];
    for (let x = to; x < to + 3; x++)
      P[x] += anchor[0] * P[x + 3] + anchor[1] * P[x + 6] + anchor[2] * P[x + 9];
    for (let k = 0; k <= this.hinges; k++) {
      const [r0, r1, r2] = turns[k];
      const c = k < this.hinges ? Math.cos(q[at + k]) : 1,
        s = k < this.hinges ? Math.sin(q[at + k]) : 0;
      for (let x = to + 3; x < to + 6; x++) {
        const a = P[x],
          b = P[x + 3],
          d = P[x + 6],
          rotatedX = r0[0] * a + r1[0] * b + r2[0] * d,
          rotatedY = r0[1] * a + r1[1] * b + r2[1] * d;
        P[x] = c * rotatedX + s * rotatedY;
        P[x + 3] = c * rotatedY - s * rotatedX;
        P[x + 6] = r0[2] * a + r1[2] * b + r2[2] * d;
      }
    }
    for (let x = to; x < to + 3; x++)
      P[x] += offset[0] * P[x + 3] + offset[1] * P[x + 6] + offset[2] * P[x + 9];
  }
}

/**
 * Make the axes of a pose orthonormal up to rounding, by a step of Newton's method.
 * @param {Float64Array} P
 * @param {number} at start of the pose
 */
export function orthonormalise(P, at) {
  const rows = [3, 6, 9].map((k) => /** @type {Vector} */ ([...P.subarray(at + k, at + k + 3)]));
  for (let r = 0; r < 3; r++)
    for (let x = 0; x < 3; x++) {
      let sum = 0;
      for (const row of rows) sum += dot(rows[r], row) * row[x];
      P[at + 3 + 3 * r + x] = 1.5 * rows[r][x] - 0.5 * sum;
    }
}
