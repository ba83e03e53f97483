import { outward } from "./camera.js";

// Choice of the direction in which the fewest modules hide the given ones.
const TURNS = 16;
const RISES = [0.15, 0.5, 0.9, -0.3];
const MOST = 12; // maximum number of modules to check
const WIDE = 0.8; // pitches; modules nearer to the line of sight hide those behind them

// Return true if other modules hide a module, seen from a direction.
/**
 * @param {Floats} positions
 * @param {number} module
 * @param {[azimuth: number, elevation: number]} from
 */
export const isHidden = (positions, module, [azimuth, elevation]) =>
  before(positions, module, outward(azimuth, elevation), new Set([module])) > 0;

/** @param {number[]} modules */
const spread = (modules) => modules.filter((_, k) => k % Math.ceil(modules.length / MOST) === 0);

// Return azimuth and elevation of the clearest sight,
// with a preference for those near the given ones.
/**
 * @param {Floats} positions
 * @param {number[]} modules
 * @param {[azimuth: number, elevation: number]} home
 * @param {((azimuth: number, elevation: number) => Vector) | null} eyeAt
 *   returns the position of the eye in pitches; null for an eye that is far away
 * @returns {[azimuth: number, elevation: number]}
 */
export function clearestSight(positions, modules, [azimuth, elevation], eyeAt = null) {
  const sample = spread(modules);
  const targets = new Set(modules);
  /** @type {[azimuth: number, elevation: number]} */
  let best = [azimuth, elevation];
  let lowestCost = Infinity;
  for (let k = 0; k < TURNS; k++) {
    for (const rise of RISES) {
      const turn = azimuth + (Math.PI * (k % 2 ? -(k + 1) : k)) / TURNS;
      const way = outward(turn, rise);
      const eye = eyeAt?.(turn, rise);
      const hidden = sample.reduce(
        (sum, module) =>
          sum + before(positions, module, eye ? towards(eye, positions, module) : way, targets),
        0,
      );
      const cost = hidden + 0.02 * k + 0.1 * Math.abs(rise - elevation);
      if (cost < lowestCost) {
        lowestCost = cost;
        best = [turn, rise];
      }
    }
  }
  return best;
}

// Return the unit vector from a module to the eye.
/**
 * @param {Vector} eye
 * @param {Floats} positions
 * @param {number} module
 * @returns {Vector}
 */
function towards(eye, positions, module) {
  const [x, y, z] = eye.map((v, k) => v - positions[3 * module + k]);
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}

// Return 1 if another module hides this one in the given direction; otherwise 0.
/**
 * @param {Floats} positions
 * @param {number} module
 * @param {Vector} way
 * @param {Set<number>} targets
 */
function before(positions, module, [x, y, z], targets) {
  const [a, b, c] = positions.subarray(3 * module, 3 * module + 3);
  for (let i = 0; i < positions.length / 3; i++) {
    if (targets.has(i)) continue;
    const [u, v, w] = [positions[3 * i] - a, positions[3 * i + 1] - b, positions[3 * i + 2] - c];
    const along = u * x + v * y + w * z;
    if (along > 0.5 && u * u + v * v + w * w - along * along < WIDE * WIDE) return 1;
  }
  return 0;
}
