// From hinge angles and a root pose to the poses of all modules; planner/modules.py tells the equation:
// T[i+1] = T[i] · Trans(anchor) · Rot(axis_1, q_1) … Rot(axis_K, q_K) · turn · Trans(offset).

// c = a · b, quaternions w, x, y, z.
function times(a, b, c) {
  const [w, x, y, z] = a;
  const [p, q, r, s] = b;
  c[0] = w * p - x * q - y * r - z * s;
  c[1] = w * q + x * p + y * s - z * r;
  c[2] = w * r - x * s + y * p + z * q;
  c[3] = w * s + x * r - y * q + z * p;
  return c;
}

// The vector (x, y, z) turned by the quaternion q.
export function turned(q, [x, y, z]) {
  const [w, a, b, c] = q;
  const u = 2 * (b * z - c * y);
  const v = 2 * (c * x - a * z);
  const t = 2 * (a * y - b * x);
  return [x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u];
}

export class Kinematics {
  // `chain` as in the scenery's header; `foldedRad` for poses of windows.
  constructor(chain, foldedRad = null) {
    this.foldedRad = foldedRad;
    this.resting = null;
    this.modules = chain.modules;
    this.root = chain.root;
    this.rigid = chain.rigid_links;
    this.hinges = chain.hinges;
    this.axes = chain.axes;
    this.anchor = chain.anchor;
    this.offset = chain.offset;
    this.turn = chain.turn;
  }

  // The rotation across the joint of a link; `angle` tells that of a hinge.
  step(angle, link, into) {
    let q = [1, 0, 0, 0];
    const first = (link - this.rigid) * this.hinges;
    if (first >= 0) {
      for (let k = 0; k < this.hinges; k++) {
        const half = angle(first + k) / 2;
        const s = Math.sin(half);
        const [x, y, z] = this.axes[k];
        q = times(q, [Math.cos(half), s * x, s * y, s * z], [0, 0, 0, 0]);
      }
    }
    return times(q, this.turn, into);
  }

  // Centres (3n) and orientations (4n) of one configuration.
  poses(angles, position, wxyz) {
    const found = this.room(Float32Array);
    const angle = (j) => angles[j];
    this.ahead(angle, this.root, this.modules, position, wxyz, found);
    const across = [0, 0, 0, 0];
    let p = Array.from(position);
    let q = Array.from(wxyz);
    for (let i = this.root - 1; i >= 0; i--) {
      const b = turned(q, this.offset);
      const [w, x, y, z] = this.step(angle, i, across);
      q = times(q, [w, -x, -y, -z], [0, 0, 0, 0]);
      const a = turned(q, this.anchor);
      p = [p[0] - a[0] - b[0], p[1] - a[1] - b[1], p[2] - a[2] - b[2]];
      put(i, p, q, found);
    }
    return found;
  }

  // The same, of a chain that is folded before the hinge `first` and straight from `last` on, with the
  // `angles` of the hinges in between and the pose of module 0. What is folded keeps its shape, and
  // what is straight is a rod: only the window is computed joint by joint. Modules up to `core` are
  // folded, those from `rod` on are the rod.
  windowPoses({ first, last, angles }, position, wxyz) {
    const { modules: n, foldedRad } = this;
    const found = this.room(Float32Array);
    const core = Math.min(n, this.rigid + Math.floor(first / this.hinges) + 1);
    const rod = Math.min(n - 1, Math.max(core - 1, this.rigid + Math.ceil(last / this.hinges)));
    const folded = this.rested(position, wxyz);
    found.positions.set(folded.positions.subarray(0, 3 * core));
    found.wxyzs.set(folded.wxyzs.subarray(0, 4 * core));
    const angle = (j) => (j < first ? foldedRad[j] : j < last ? angles[j - first] : 0);
    const [p, q] = this.ahead(angle, core - 1, rod + 1, ...poseIn(folded, core - 1), found);
    moved(this.straight, rod, n, p, q, found);
    return { ...found, core, rod };
  }

  // From the pose of `begin` on to that of `end` - 1, which is told.
  ahead(angle, begin, end, position, wxyz, found) {
    const across = [0, 0, 0, 0];
    const p = Array.from(position);
    let q = Array.from(wxyz);
    put(begin, p, q, found);
    for (let i = begin + 1; i < end; i++) {
      const a = turned(q, this.anchor);
      q = times(q, this.step(angle, i - 1, across), [0, 0, 0, 0]);
      const b = turned(q, this.offset);
      for (let k = 0; k < 3; k++) p[k] += a[k] + b[k];
      put(i, p, q, found);
    }
    return [p, q];
  }

  // The folded chain with its first module there, kept until that moves.
  rested(position, wxyz) {
    const key = [...position, ...wxyz].join();
    if (this.resting?.key !== key) {
      const length = Math.hypot(...wxyz);
      this.resting = { key, ...this.room(Float64Array) };
      moved(this.folded, 0, this.modules, position, Array.from(wxyz, (v) => v / length), this.resting);
    }
    return this.resting;
  }

  // The folded and the straight chain from the first module on.
  get folded() { return (this.foldedTable ??= this.table((j) => this.foldedRad[j])); }

  get straight() { return (this.straightTable ??= this.table(() => 0)); }

  table(angle) {
    const found = this.room(Float64Array);
    this.ahead(angle, 0, this.modules, [0, 0, 0], [1, 0, 0, 0], found);
    return found;
  }

  room(Type) { return { positions: new Type(3 * this.modules), wxyzs: new Type(4 * this.modules) }; }
}

const poseIn = ({ positions, wxyzs }, i) => [positions.subarray(3 * i, 3 * i + 3), wxyzs.subarray(4 * i, 4 * i + 4)];

// Puts one pose in its place, its orientation as a unit quaternion.
function put(i, p, q, { positions, wxyzs }) {
  const l = Math.hypot(q[0], q[1], q[2], q[3]);
  for (let k = 0; k < 3; k++) positions[3 * i + k] = p[k];
  for (let k = 0; k < 4; k++) wxyzs[4 * i + k] = q[k] /= l;
}

// Puts the modules from `begin` to `end` - 1 of a chain that keeps the shape of `table`, when the pose
// of `begin` is p, q.
function moved({ positions: from, wxyzs: turns }, begin, end, p, q, { positions, wxyzs }) {
  const [d, e, f, g] = turns.subarray(4 * begin, 4 * begin + 4);
  const [w, x, y, z] = times(q, [d, -e, -f, -g], [0, 0, 0, 0]);
  const r = [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
  for (let i = begin; i < end; i++) {
    const a = from[3 * i] - from[3 * begin];
    const b = from[3 * i + 1] - from[3 * begin + 1];
    const c = from[3 * i + 2] - from[3 * begin + 2];
    positions[3 * i] = p[0] + r[0] * a + r[1] * b + r[2] * c;
    positions[3 * i + 1] = p[1] + r[3] * a + r[4] * b + r[5] * c;
    positions[3 * i + 2] = p[2] + r[6] * a + r[7] * b + r[8] * c;
    const k = 4 * i;
    wxyzs[k] = w * turns[k] - x * turns[k + 1] - y * turns[k + 2] - z * turns[k + 3];
    wxyzs[k + 1] = w * turns[k + 1] + x * turns[k] + y * turns[k + 3] - z * turns[k + 2];
    wxyzs[k + 2] = w * turns[k + 2] - x * turns[k + 3] + y * turns[k] + z * turns[k + 1];
    wxyzs[k + 3] = w * turns[k + 3] + x * turns[k + 2] - y * turns[k + 1] + z * turns[k];
  }
}

// Which module a ray meets first, or null.
export function picked(chain, { positions, wxyzs }, origin, direction) {
  const spans = chain.face_normals.map((normal) => {
    const heights = chain.vertices.map((v) => v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]);
    return [normal, Math.min(...heights), Math.max(...heights)];
  });
  let best = null;
  let nearest = Infinity;
  for (let i = 0; i < chain.modules; i++) {
    const back = [wxyzs[4 * i], -wxyzs[4 * i + 1], -wxyzs[4 * i + 2], -wxyzs[4 * i + 3]];
    const start = turned(back, [origin[0] - positions[3 * i], origin[1] - positions[3 * i + 1], origin[2] - positions[3 * i + 2]]);
    const way = turned(back, direction);
    let enter = -Infinity;
    let leave = Infinity;
    for (const [n, low, high] of spans) {
      const along = way[0] * n[0] + way[1] * n[1] + way[2] * n[2];
      const at = start[0] * n[0] + start[1] * n[1] + start[2] * n[2];
      const one = (low - at) / along;
      const two = (high - at) / along;
      enter = Math.max(enter, Math.min(one, two));
      leave = Math.min(leave, Math.max(one, two));
    }
    if (enter <= leave && leave > 0 && enter < nearest) { nearest = enter; best = i; }
  }
  return best;
}
