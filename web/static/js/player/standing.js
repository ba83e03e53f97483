// The finished shape stands as it was drawn. A chain that floats turns as a whole while it folds, so the
// orientation at the end of a simulated fold is not that of the drawing. The playback is shown in a frame
// of reference that turns evenly: not at all at the straight chain, fully at the last frame. Only the
// orientation of the first or root module changes; hinge angles and files stay as recorded.

/** Seconds in which the correction fades in when a timeline is completed on an open page. Chosen. */
const FADE_S = 0.8;
const SAME = 1e-9;

/** @typedef {[w: number, x: number, y: number, z: number]} Turn */

/**
 * @param {Numbers} a
 * @param {Numbers} b
 * @returns {Turn}
 */
function product(a, b) {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3], a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
  ];
}

export class Standing {
  /** @type {{ angle: number, axis: Vector, from: number, to: number } | null} */
  correction = null;
  amount = 0; // of the correction that is shown, 0 to 1

  // Sets the correction from the orientations of one module at the last frame and in the drawing.
  /**
   * @param {Numbers} end
   * @param {Numbers} drawn
   * @param {Phase} folding
   * @param {boolean} fade
   */
  set(end, drawn, { from, to }, fade) {
    const length = Math.hypot(...Array.from(end)) * Math.hypot(...Array.from(drawn));
    const [w, x, y, z] = product(drawn, [end[0], -end[1], -end[2], -end[3]]).map((v) => v / length);
    const sine = Math.hypot(x, y, z) * (w < 0 ? -1 : 1); // the short way
    this.correction = Math.abs(sine) < SAME ? null : { angle: 2 * Math.atan2(Math.abs(sine), Math.abs(w)), axis: [x / sine, y / sine, z / sine], from, to };
    if (!fade) this.amount = 1;
  }

  clear() {
    this.correction = null;
    this.amount = 0;
  }

  get fading() { return this.correction !== null && this.amount < 1; }

  // Lets seconds pass; true while the correction fades in.
  /** @param {number} passed */
  advance(passed) {
    if (!this.fading) return false;
    this.amount = Math.min(1, this.amount + passed / FADE_S);
    return true;
  }

  // The orientation that is shown in place of a recorded one at a frame.
  /**
   * @param {Floats} wxyz
   * @param {number} frame
   */
  turned(wxyz, frame) {
    const { correction, amount } = this;
    if (!correction || !amount || frame <= correction.from) return wxyz;
    const { angle, axis: [x, y, z], from, to } = correction;
    const half = (angle / 2) * amount * smooth(Math.min(1, (frame - from) / Math.max(1, to - 1 - from)));
    const s = Math.sin(half);
    return Float64Array.from(product([Math.cos(half), s * x, s * y, s * z], wxyz));
  }
}

/** @param {number} share */
const smooth = (share) => share * share * (3 - 2 * share);
