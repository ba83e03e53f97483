// Camera that keeps the whole chain in view and moves smoothly; picking of modules; rotations.
// `web/pictures/camera.py` frames movies by the same equations.
const MOST_POINTS = 600;
/** @type {Vector[]} */
const WAYS = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
  [0, 1, 1],
  [0, 1, -1],
  [1, 0, 1],
  [1, 0, -1],
  [1, 1, 0],
  [1, -1, 0],
  [1, 1, 1],
  [1, 1, -1],
  [1, -1, 1],
  [1, -1, -1],
];
const SETTLE_S = 0.14;
const SETTLED = 2e-4;
const WHOLE_TURN = 2 * Math.PI;
const MAX_ELEVATION = 1.56; // rad; at π/2 the up direction is undefined

/**
 * @param {Vector} a
 * @param {Vector} b
 */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const between = (/** @type {number} */ angle) =>
  ((((angle + Math.PI) % WHOLE_TURN) + WHOLE_TURN) % WHOLE_TURN) - Math.PI;

/**
 * @param {number} azimuth
 * @param {number} elevation
 * @returns {Vector}
 */
export function outward(azimuth, elevation) {
  const flat = Math.cos(elevation);
  return [flat * Math.cos(azimuth), flat * Math.sin(azimuth), Math.sin(elevation)];
}

/**
 * @param {View} view
 * @returns {Vector}
 */
export function positionOf(view) {
  const out = outward(view.azimuth, view.elevation);
  return vector((k) => view.target[k] + view.distance * out[k]);
}

// Return azimuth and elevation of `position` as seen from `target`.
/**
 * @param {Vector} position
 * @param {Vector} target
 * @returns {[azimuth: number, elevation: number]}
 */
function anglesOf(position, target) {
  const off = position.map((v, k) => v - target[k]);
  const length = Math.max(Math.hypot(...off), 1e-9);
  return [Math.atan2(off[1], off[0]), Math.asin(Math.min(1, Math.max(-1, off[2] / length)))];
}

/**
 * @param {number} azimuth
 * @param {number} elevation
 * @returns {[right: Vector, up: Vector, out: Vector]}
 */
export function axesOf(azimuth, elevation) {
  const out = outward(azimuth, elevation);
  /** @type {Vector} */
  const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  return [right, cross(out, right), out];
}

// Return some hundreds of points that represent all n: a regular
// sample, and the extreme points in both directions along each of WAYS.
/**
 * @param {Numbers} points
 * @param {number} n
 * @returns {Vector[]}
 */
export function fewPoints(points, n = points.length / 3) {
  const by = Math.max(1, Math.floor(n / MOST_POINTS));
  const numbers = [];
  for (let i = 0; i < n; i += by) numbers.push(i);
  if (by > 1) {
    for (const [x, y, z] of WAYS) {
      let low = 0;
      let high = 0;
      let [lowest, highest] = [Infinity, -Infinity];
      for (let i = 0; i < n; i++) {
        const along = x * points[3 * i] + y * points[3 * i + 1] + z * points[3 * i + 2];
        if (along < lowest) {
          lowest = along;
          low = i;
        }
        if (along > highest) {
          highest = along;
          high = i;
        }
      }
      numbers.push(low, high);
    }
  }
  return numbers.map((i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]]);
}

/** @param {(axis: number) => number} part */
const vector = (part) => /** @type {Vector} */ ([part(0), part(1), part(2)]);

// Return the midpoint between the minimum and the maximum.
/** @param {number[]} values */
const midway = (values) => (Math.min(...values) + Math.max(...values)) / 2;

// Return the nearest view that shows all points: centres
// of modules with the given radius; see fewPoints.
/**
 * @param {Vector[]} points
 * @param {Seeing & { elevation: number, azimuth?: number | null, margin?: [number, number] }}
 *   seeing
 * @returns {View}
 */
export function framing(
  points,
  { radius, aspect, field, home, azimuth = null, elevation, margin = [0.9, 0.72] },
) {
  azimuth ??= sideOf(points, aspect, home ?? 0);
  const axes = axesOf(azimuth, elevation);
  const local = points.map((p) => vector((k) => dot(p, axes[k])));
  const middle = vector((k) => midway(local.map((p) => p[k])));
  const tall = Math.tan(field / 2);
  const wide = tall * aspect;
  let distance = radius;
  for (let round = 0; round < 3; round++) {
    // perspective shifts the middle; a few rounds centre the picture
    const eyeDistance = local.reduce((far, p) => {
      const [x, y, z] = vector((k) => p[k] - middle[k]);
      return Math.max(
        far,
        (Math.abs(x) + radius) / (wide * margin[0]) + z,
        (Math.abs(y) + radius) / (tall * margin[1]) + z,
      );
    }, 4 * radius);
    for (const k of [0, 1])
      middle[k] +=
        midway(local.map((p) => (p[k] - middle[k]) / (eyeDistance - (p[2] - middle[2])))) *
        eyeDistance;
    distance = eyeDistance;
  }
  const target = vector((c) => axes.reduce((sum, axis, k) => sum + middle[k] * axis[c], 0));
  return { target, azimuth, elevation, distance };
}

// Return the minimum distance from the view's target at which all points are in view.
/**
 * @param {Vector[]} points
 * @param {View} view
 * @param {Seeing} seeing
 */
export function distanceNeeded(points, view, { radius, aspect, field }) {
  const [right, up, out] = axesOf(view.azimuth, view.elevation);
  const tall = Math.tan(field / 2);
  let needed = 0;
  for (const p of points) {
    const off = vector((k) => p[k] - view.target[k]);
    const depth = dot(off, out);
    needed = Math.max(
      needed,
      (Math.abs(dot(off, right)) + radius) / (tall * aspect) + depth,
      (Math.abs(dot(off, up)) + radius) / tall + depth,
    );
  }
  return needed;
}

// Return the target of a view, moved to the right and
// up in the picture by fractions of the distance.
/**
 * @param {View} view
 * @param {number} x
 * @param {number} y
 */
export function across({ target, azimuth, elevation, distance }, x, y) {
  const [right, up] = axesOf(azimuth, elevation);
  return vector((k) => target[k] + distance * (x * right[k] + y * up[k]));
}

export const clamp = (
  /** @type {number} */ value,
  /** @type {number} */ low,
  /** @type {number} */ high,
) => Math.min(high, Math.max(low, value));
export const steep = (/** @type {number} */ elevation) =>
  clamp(elevation, -MAX_ELEVATION, MAX_ELEVATION);

// Return a view that a pointer or key has turned, zoomed and moved.
/**
 * @param {View} view
 * @param {Orbit} orbit
 * @param {number} field vertical angle of view, rad
 * @param {[nearest: number, farthest: number]} distances
 * @returns {View}
 */
export function orbited(
  { azimuth, elevation, distance, target },
  { turn = [0, 0], zoom = 1, move = [0, 0] },
  field,
  [nearest, farthest],
) {
  const view = {
    azimuth: azimuth + turn[0],
    elevation: steep(elevation + turn[1]),
    distance: zoom === 1 ? distance : clamp(distance * zoom, nearest, farthest),
    target,
  };
  const height = 2 * Math.tan(field / 2); // of the picture, as a fraction of the distance
  return { ...view, target: across(view, -height * move[0], -height * move[1]) };
}

// Return the ray from the camera through a point of the picture,
// given as fractions of its width and height from the top left.
/**
 * @param {Eye} eye
 * @param {[x: number, y: number]} place
 * @param {number} aspect
 * @param {number} field vertical angle of view, rad
 * @returns {[origin: Vector, direction: Vector]}
 */
export function rayThrough({ position, target }, [x, y], aspect, field) {
  const [right, up, out] = axesOf(...anglesOf(position, target));
  const tall = Math.tan(field / 2);
  const way = vector(
    (k) => (2 * x - 1) * tall * aspect * right[k] + (1 - 2 * y) * tall * up[k] - out[k],
  );
  const length = Math.hypot(...way);
  return [position, vector((k) => way[k] / length)];
}

// Return the weighted mean of several views, far enough away to contain the nearest one.
/**
 * @param {View[]} views
 * @param {number[]} weights
 * @param {View} nearest
 * @returns {View}
 */
export function blended(views, weights, nearest) {
  const total = weights.reduce((a, b) => a + b, 0);
  const share = weights.map((w) => w / total);
  const mean = (/** @type {(view: View) => number} */ value) =>
    views.reduce((sum, view, k) => sum + share[k] * value(view), 0);
  const target = vector((c) => mean((v) => v.target[c]));
  const offset = Math.hypot(...target.map((v, k) => v - nearest.target[k]));
  return {
    target,
    azimuth: nearest.azimuth + mean((v) => between(v.azimuth - nearest.azimuth)),
    elevation: nearest.elevation + mean((v) => v.elevation - nearest.elevation),
    distance: Math.max(Math.exp(mean((v) => Math.log(v.distance))), nearest.distance + offset),
  };
}

// Return a view some seconds later on its glide to the goal; the goal itself on arrival.
/**
 * @param {View} view
 * @param {View} goal
 * @param {number} seconds
 * @returns {View}
 */
export function glided(view, goal, seconds) {
  const share = 1 - Math.exp(-seconds / SETTLE_S);
  const turn = between(goal.azimuth - view.azimuth);
  const rise = goal.elevation - view.elevation;
  const off = Math.hypot(...goal.target.map((v, k) => v - view.target[k])) / goal.distance;
  if (
    Math.max(off, Math.abs(turn), Math.abs(rise), Math.abs(goal.distance / view.distance - 1)) <
    SETTLED
  )
    return goal;
  return {
    target: vector((k) => view.target[k] + (goal.target[k] - view.target[k]) * share),
    azimuth: view.azimuth + turn * share,
    elevation: view.elevation + rise * share,
    distance: view.distance * (goal.distance / view.distance) ** share,
  };
}

// Return the azimuth that shows a long chain from
// its side, or from nearer its end in a tall window.
/**
 * @param {Vector[]} points
 * @param {number} aspect
 * @param {number} home
 */
function sideOf(points, aspect, home) {
  const mean = [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  const spread = [
    [0, 0, 0],
    [0, 0, 0],
    [0, 0, 0],
  ];
  for (const p of points)
    for (let a = 0; a < 3; a++)
      for (let b = 0; b < 3; b++) spread[a][b] += (p[a] - mean[a]) * (p[b] - mean[b]);
  const { axis, longest, second } = principal(spread);
  const slim = 1 - Math.sqrt(Math.max(second, 0) / Math.max(longest, 1e-12));
  const weight = Math.min(1, Math.max(0, (slim - 0.4) / 0.4)) * Math.hypot(axis[0], axis[1]);
  const along = Math.atan2(axis[1], axis[0]);
  const offset = ((aspect >= 1 ? 68 : 30) * Math.PI) / 180;
  const turns = [-offset, offset, Math.PI - offset, Math.PI + offset].map((side) =>
    between(along + side - home),
  );
  return home + weight * turns.reduce((a, b) => (Math.abs(b) < Math.abs(a) ? b : a));
}

// Return the two largest eigenvalues of a positive semidefinite symmetric
// 3×3 matrix and the axis of the largest, by power iteration. The result
// is inexact if both are similar: then the shape has no long side.
/** @param {number[][]} matrix */
function principal(matrix) {
  const trace = (/** @type {number[][]} */ m) => m[0][0] + m[1][1] + m[2][2];
  const square = (/** @type {number[][]} */ m) =>
    m.map((row) => row.map((_, k) => row.reduce((sum, v, j) => sum + v * m[j][k], 0)));
  let power = matrix;
  for (let k = 0; k < 9; k++) {
    const size = trace(power) || 1;
    power = square(power.map((row) => row.map((v) => v / size)));
  }
  const column = power.reduce((a, b) => (Math.hypot(...b) > Math.hypot(...a) ? b : a));
  const axis = column.map((v) => v / (Math.hypot(...column) || 1));
  const longest = axis.reduce(
    (sum, v, j) => sum + v * matrix[j].reduce((all, w, k) => all + w * axis[k], 0),
    0,
  );
  // The sum and the sum of squares of the other two eigenvalues are known.
  const [sum, squares] = [trace(matrix) - longest, trace(square(matrix)) - longest ** 2];
  return { axis, longest, second: sum / 2 + Math.sqrt(Math.max(0, squares / 2 - sum ** 2 / 4)) };
}

// Return the piece that a module is.
/**
 * @param {Pick<Pieces, "pattern">} pieces
 * @param {number} module
 */
export const pieceOf = ({ pattern }, module) => pattern[module % pattern.length];

// Return, for each kind of piece in a chain, its number and the modules that it is.
/**
 * @param {Pieces} pieces
 * @returns {[piece: number, members: number[]][]}
 */
export function membersOf(pieces) {
  /** @type {number[][]} */
  const members = pieces.pieces.map(() => []);
  for (let i = 0; i < pieces.modules; i++) members[pieceOf(pieces, i)].push(i);
  return [...members.entries()].filter(([, modules]) => modules.length);
}

// Return the values of some modules, `width` for each.
/**
 * @template {Float32Array | Float64Array | Uint8Array} Values
 * @param {Values} values
 * @param {number[]} members
 * @param {number} width
 * @returns {Values}
 */
export function valuesOf(values, members, width) {
  if (members.length * width === values.length) return values;
  const chosen = /** @type {Values} */ (values.slice(0, members.length * width));
  members.forEach((i, k) => chosen.set(values.subarray(width * i, width * (i + 1)), width * k));
  return chosen;
}

// Return the first module that a ray hits; null if there is none.
/**
 * @param {Hull} hull
 * @param {{ positions: Numbers, wxyzs: Numbers }} poses
 * @param {Vector} origin
 * @param {Vector} direction
 */
export function picked(hull, { positions, wxyzs }, origin, direction) {
  const spansOfParts = hull.parts.map(({ face_normals: normals, vertices }) =>
    normals.map((normal) => {
      const heights = vertices.map((v) => v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]);
      return /** @type {const} */ ([normal, Math.min(...heights), Math.max(...heights)]);
    }),
  );
  let best = null;
  let nearest = Infinity;
  for (let i = 0; i < hull.modules; i++) {
    /** @type {Quaternion} */
    const inverse = [wxyzs[4 * i], -wxyzs[4 * i + 1], -wxyzs[4 * i + 2], -wxyzs[4 * i + 3]];
    const start = turned(inverse, [
      origin[0] - positions[3 * i],
      origin[1] - positions[3 * i + 1],
      origin[2] - positions[3 * i + 2],
    ]);
    const way = turned(inverse, direction);
    for (const spans of spansOfParts.slice(...hull.pieces[pieceOf(hull, i)])) {
      let enter = -Infinity;
      let leave = Infinity;
      for (const [n, low, high] of spans) {
        const along = way[0] * n[0] + way[1] * n[1] + way[2] * n[2];
        const at = start[0] * n[0] + start[1] * n[1] + start[2] * n[2];
        const toLow = (low - at) / along;
        const toHigh = (high - at) / along;
        enter = Math.max(enter, Math.min(toLow, toHigh));
        leave = Math.min(leave, Math.max(toLow, toHigh));
      }
      if (enter <= leave && leave > 0 && enter < nearest) {
        nearest = enter;
        best = i;
      }
    }
  }
  return best;
}

// Rotations.

// Return the product of two quaternions (w, x, y, z).
/**
 * @param {Quaternion} a
 * @param {Quaternion} b
 * @returns {Quaternion}
 */
export const times = ([w, x, y, z], [p, q, r, s]) => [
  w * p - x * q - y * r - z * s,
  w * q + x * p + y * s - z * r,
  w * r - x * s + y * p + z * q,
  w * s + x * r - y * q + z * p,
];

// Return the vector (x, y, z) rotated by the quaternion q.
/**
 * @param {Quaternion} q
 * @param {Vector} vector
 * @returns {Vector}
 */
export function turned(q, [x, y, z]) {
  const [w, a, b, c] = q;
  const u = 2 * (b * z - c * y);
  const v = 2 * (c * x - a * z);
  const t = 2 * (a * y - b * x);
  return [x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u];
}

// Return the orientation of module i from those of all modules.
export const quaternionOf = (/** @type {Numbers} */ q, i = 0) =>
  /** @type {Quaternion} */ ([q[4 * i], q[4 * i + 1], q[4 * i + 2], q[4 * i + 3]]);
