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
  // `chain` as in the scenery's header.
  constructor(chain) {
    this.modules = chain.modules;
    this.root = chain.root;
    this.rigid = chain.rigid_links;
    this.hinges = chain.hinges;
    this.axes = chain.axes;
    this.anchor = chain.anchor;
    this.offset = chain.offset;
    this.turn = chain.turn;
  }

  // The rotation across the joint of a link.
  step(angles, link, into) {
    let q = [1, 0, 0, 0];
    const first = (link - this.rigid) * this.hinges;
    if (first >= 0) {
      for (let k = 0; k < this.hinges; k++) {
        const half = angles[first + k] / 2;
        const s = Math.sin(half);
        const [x, y, z] = this.axes[k];
        q = times(q, [Math.cos(half), s * x, s * y, s * z], [0, 0, 0, 0]);
      }
    }
    return times(q, this.turn, into);
  }

  // Centres (3n) and orientations (4n) of one configuration.
  poses(angles, position, wxyz) {
    const n = this.modules;
    const positions = new Float32Array(3 * n);
    const wxyzs = new Float32Array(4 * n);
    const put = (i, p, q) => {
      positions.set(p, 3 * i);
      const l = Math.hypot(q[0], q[1], q[2], q[3]);
      for (let k = 0; k < 4; k++) wxyzs[4 * i + k] = q[k] /= l;
    };
    const across = [0, 0, 0, 0];
    let p = Array.from(position);
    let q = Array.from(wxyz);
    put(this.root, p, q);
    for (let i = this.root; i < n - 1; i++) {
      const a = turned(q, this.anchor);
      q = times(q, this.step(angles, i, across), [0, 0, 0, 0]);
      const b = turned(q, this.offset);
      p = [p[0] + a[0] + b[0], p[1] + a[1] + b[1], p[2] + a[2] + b[2]];
      put(i + 1, p, q);
    }
    p = Array.from(position);
    q = Array.from(wxyz);
    for (let i = this.root - 1; i >= 0; i--) {
      const b = turned(q, this.offset);
      const [w, x, y, z] = this.step(angles, i, across);
      q = times(q, [w, -x, -y, -z], [0, 0, 0, 0]);
      const a = turned(q, this.anchor);
      p = [p[0] - a[0] - b[0], p[1] - a[1] - b[1], p[2] - a[2] - b[2]];
      put(i, p, q);
    }
    return { positions, wxyzs };
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
