// Which modules of a folded chain touch with their faces: what is folded is hidden where they do.

const FINE = 4; // places of a pitch that are told apart
const FAR = 2 ** 16;
const WIDE = 2 ** 17;

// For each module, face by face of `sketch`, the module that it touches there; `modules` where none.
// `sketch` and `shown_size` as in the scene bundle's header, poses of the folded chain.
/**
 * @param {Pick<BundleHeader, "sketch" | "shown_size">} header
 * @param {Poses} folded
 */
export function touching({ sketch, shown_size: size }, { positions, wxyzs }) {
  const { modules: n, corners, faces } = sketch;
  const middles = faces.map((face) => [0, 1, 2].map((c) => face.reduce((sum, v) => sum + corners[v][c], 0) / face.length / size));
  const found = new Int32Array(n * faces.length).fill(n);
  const seen = new Map();
  for (let i = 0; i < n; i++) {
    const [w, x, y, z] = wxyzs.subarray(4 * i, 4 * i + 4);
    const [p, q, r] = positions.subarray(3 * i, 3 * i + 3);
    middles.forEach(([a, b, c], f) => {
      const u = 2 * (y * c - z * b);
      const v = 2 * (z * a - x * c);
      const t = 2 * (x * b - y * a);
      const at = [p + a + w * u + y * t - z * v, q + b + w * v + z * u - x * t, r + c + w * t + x * v - y * u];
      const key = at.reduce((sum, s) => sum * WIDE + Math.round(FINE * s) + FAR, 0);
      const other = seen.get(key);
      if (other === undefined) { seen.set(key, i * faces.length + f); return; }
      found[i * faces.length + f] = Math.floor(other / faces.length);
      found[other] = i;
    });
  }
  return found;
}

// For each module how many must be folded, from the first on, until all of its faces are hidden.
/**
 * @param {Int32Array} neighbours
 * @param {number} modules
 */
export function buriedBy(neighbours, modules) {
  const faces = neighbours.length / modules;
  return Int32Array.from({ length: modules }, (_, i) => {
    let most = i;
    for (let f = 0; f < faces; f++) most = Math.max(most, neighbours[i * faces + f]);
    return most + 1;
  });
}
