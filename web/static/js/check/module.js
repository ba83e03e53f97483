// Modules, scaled to their size: pieces of convex parts, and links to
// the next module: anchor, turn, hinge about the third axis, turn, ..., offset.

/** @typedef {[number, number, number]} Vector */
/** @typedef {{ corners: Vector[], faces: Vector[], edges: Vector[] }} Body a convex part */
/**
 * @typedef {{ anchor: Vector, offset: Vector, turns: Vector[][],
 *   ranges_rad: [number, number][] }} Link
 */
/**
 * @typedef {{ pieces: Body[][], links: Link[], pattern: [number, number][], hinges: string[],
 *   rigid_links: number, apart: number }} Geometry a plan's description of modules
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
/** @type {Vector[]} */
const BOX = HALVES.flatMap((x) =>
  HALVES.flatMap((y) => HALVES.map((z) => /** @type {Vector} */ ([x, y, z]))),
);
/** @type {Vector[]} */
const WEDGE = [
  [-1 / 3, -1 / 3],
  [2 / 3, -1 / 3],
  [-1 / 3, 2 / 3],
].flatMap(([x, y]) => HALVES.map((z) => /** @type {Vector} */ ([x, y, z])));
/** Modules of one part whose hinges turn as far either way. @type {Record<string, any>} */
export const KNOWN = {
  cube: {
    corners: BOX,
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

/**
 * Modules that twist freely: of each piece its corners, the place and
 * the axis of the joint before it, and those of the joint behind it.
 * @type {Record<string, Vector[][]>}
 */
export const TWISTS = {
  "snake-prism": [[...WEDGE, [-1 / 3, 1 / 6, 0], ONE[0], [1 / 6, -1 / 3, 0], [0, -1, 0]]],
  "snake-cube": [
    [...BOX, [-0.5, 0, 0], ONE[0], [0.5, 0, 0], ONE[0]],
    [...BOX, [-0.5, 0, 0], ONE[0], [0, 0.5, 0], ONE[1]],
  ],
};
/** Angle by which a hinge without a range turns at most, either way, rad. */
export const FREE = 2 * Math.PI;

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

/** A convex part at its size. */
export class Part {
  /**
   * @param {Body} body
   * @param {number} size
   */
  constructor({ corners, faces, edges }, size) {
    this.corners = corners.map(
      ([x, y, z]) => /** @type {Vector} */ ([x * size, y * size, z * size]),
    );
    this.faces = faces;
    this.edges = edges;
    /** @type {Vector} */
    this.centre = [0, 0, 0];
    for (const v of this.corners)
      for (let x = 0; x < 3; x++) this.centre[x] += v[x] / corners.length;
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
}

export class Module {
  /**
   * @param {Geometry} geometry
   * @param {number} size
   */
  constructor(geometry, size) {
    const { pieces, links } = geometry;
    this.geometry = geometry;
    this.pieces = pieces.map((parts) => parts.map((body) => new Part(body, size)));
    this.radius = Math.max(...this.pieces.flat().flatMap(({ corners }) => corners.map(norm)));
    this.length = 0;
    for (const { anchor, offset } of links)
      this.length = Math.max(this.length, (norm(anchor) + norm(offset)) * (1 + 1e-12));
    this.hinges = geometry.hinges.length;
    this.exact = links.every(({ turns }) =>
      turns.flat(2).every((v) => v === 0 || Math.abs(v) === 1),
    );
    this.isStraightExact =
      this.exact &&
      links.every(({ anchor, offset }) =>
        [...anchor, ...offset].every((v) => Number.isInteger(2 * v)),
      );
  }

  /** Return the parts of a module of the chain. @param {number} i */
  piece(i) {
    const { pattern } = this.geometry;
    return this.pieces[pattern[i % pattern.length][0]];
  }

  /** Return the link behind a module of the chain. @param {number} i */
  link(i) {
    const { pattern, links } = this.geometry;
    return links[pattern[i % pattern.length][1]];
  }

  /**
   * True if the turns are rotations, the face normals have
   * length 1, and all other numbers are in their ranges.
   */
  get sound() {
    const { pieces, links } = this.geometry,
      small = (/** @type {Vector[]} */ ...vectors) =>
        vectors.every((v) => v.every((x) => Math.abs(x) < 1e6));
    return (
      this.length > 1e-6 &&
      links.every(
        ({ anchor, offset, turns, ranges_rad: ranges }) =>
          small(anchor, offset) &&
          ranges.every(
            ([low, high]) => low < high && low <= 0 && high >= 0 && Math.max(-low, high) <= FREE,
          ) &&
          turns.every(
            (rows) =>
              dot(rows[0], cross(rows[1], rows[2])) > 0 &&
              rows.every((a, i) =>
                rows.every((b, j) => Math.abs(dot(a, b) - Number(i === j)) < 1e-15),
              ),
          ),
      ) &&
      pieces
        .flat()
        .every(
          ({ corners, faces, edges }) =>
            small(...corners, ...edges) && faces.every((f) => Math.abs(dot(f, f) - 1) < 1e-15),
        )
    );
  }

  /**
   * Write the pose of the module after module i (centre, then three
   * axes), given that of module i and the angles of all hinges.
   * @type {(P: Float64Array, from: number, to: number, q: Float64Array, i: number) => void}
   */
  next(P, from, to, q, i) {
    const { anchor, offset, turns } = this.link(i),
      at = i * this.hinges;
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

/**
 * Return true if a description is that of foldback's module of this name. Twist modules
 * may be in any order and shape at rest, and the frames of their pieces turned in any way.
 * @type {(kind: string, described: Geometry, plain: (values: any) => Geometry) => boolean}
 */
export function isKnown(kind, described, plain) {
  if (Object.hasOwn(KNOWN, kind))
    return JSON.stringify(described) === JSON.stringify(plain(KNOWN[kind]));
  const { pieces, links, pattern, hinges, rigid_links: rigid, apart } = described;
  return (
    hinges.length === 1 &&
    apart === 1 &&
    rigid === 0 &&
    links.every(({ ranges_rad: [[low, high]] }) => low === -FREE && high === FREE) &&
    pattern.every(([piece, link], k) => {
      const before = links[pattern.at(k - 1)?.[1] ?? 0],
        { anchor, turns } = links[link],
        [{ corners }] = pieces[piece],
        [x, y, z] = before.offset;
      const axis = /** @type {Vector} */ (turns[0].map((row) => row[2])),
        rows = [...corners, [-x, -y, -z], before.turns[1][2], anchor, axis];
      return (
        pieces[piece].length === 1 &&
        TWISTS[kind].some(
          (known) =>
            known.length === rows.length &&
            rows.every((a, i) =>
              rows.every(
                (b, j) =>
                  Math.abs(
                    dot(/** @type {Vector} */ (a), /** @type {Vector} */ (b)) -
                      dot(known[i], known[j]),
                  ) < 1e-9,
              ),
            ),
        )
      );
    })
  );
}
