// Pointers and wheels on a 3D view.

const STILL_PX = { mouse: 4, touch: 10 }; // how far a press may move and still be a tap; chosen
const TURN_RAD = 2 * Math.PI; // for a way as long as the view is high
const ZOOM_PER_PX = 0.0012; // of a wheel, as an exponent
const MAX_WHEEL_PX = 400; // of one event

/** @typedef {{ x: number, y: number, fromX: number, fromY: number, button: number, still: number, drags: boolean }} Finger */

// Pointers on a view, which move the camera. A press that hardly moves is a tap. One pointer turns the camera, with the right or the
// middle button it moves the picture; two zoom, and move the picture unless the chain is followed.
export class Hand {
  /**
   * @param {(orbit: Orbit) => void} does
   * @param {{ height: () => number, follows: () => boolean, tap: (x: number, y: number) => void }} view its height in pixels
   */
  constructor(does, { height, follows, tap }) {
    this.does = does;
    this.height = height;
    this.follows = follows;
    this.tap = tap;
    /** @type {Map<number, Finger>} */
    this.fingers = new Map();
  }

  /** @param {Pointer} pointer */
  hear({ kind, id, x, y, by, button, touch }) {
    const { fingers } = this;
    const finger = fingers.get(id);
    if (kind === "pointerdown") {
      for (const other of fingers.values()) other.drags = true;
      fingers.set(id, { x, y, fromX: x, fromY: y, button, still: touch ? STILL_PX.touch : STILL_PX.mouse, drags: fingers.size > 0 });
    } else if (kind === "pointerup" || kind === "pointercancel") {
      fingers.delete(id);
      if (kind === "pointerup" && finger && !finger.drags && finger.button === 0) this.tap(x, y);
    } else if (kind === "wheel") this.does({ zoom: Math.exp(ZOOM_PER_PX * Math.min(MAX_WHEEL_PX, Math.max(-MAX_WHEEL_PX, by))) });
    else if (kind === "pointermove") this.drag(id, x, y);
  }

  /**
   * @param {number} id
   * @param {number} x
   * @param {number} y
   */
  drag(id, x, y) {
    const finger = this.fingers.get(id);
    if (!finger) return;
    finger.drags ||= Math.hypot(x - finger.fromX, y - finger.fromY) > finger.still;
    if (!finger.drags) return;
    const before = this.spread();
    const [dx, dy] = [(x - finger.x) / this.height(), (y - finger.y) / this.height()];
    Object.assign(finger, { x, y });
    if (this.fingers.size > 1) {
      const after = this.spread();
      /** @type {Orbit} */
      const orbit = before > 0 && after > 0 ? { zoom: before / after } : {};
      if (!this.follows()) orbit.move = [dx / this.fingers.size, -dy / this.fingers.size];
      this.does(orbit);
    } else this.does(finger.button > 0 ? { move: [dx, -dy] } : { turn: [-TURN_RAD * dx, TURN_RAD * dy] });
  }

  // How far two fingers are apart.
  spread() {
    const [a, b] = [...this.fingers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  // Listens to an element of the page itself.
  /** @param {HTMLElement} element */
  on(element) {
    const hear = (/** @type {PointerEvent | WheelEvent} */ event) => {
      if (event.target !== element) return;
      const { type: kind, offsetX: x, offsetY: y, button } = event;
      if (event instanceof WheelEvent) {
        event.preventDefault();
        this.hear({ kind, id: 0, x, y, by: event.deltaY, button, touch: false });
        return;
      }
      const { pointerId: id, pointerType } = event;
      if (kind === "pointerdown") element.setPointerCapture(id);
      this.hear({ kind, id, x, y, by: 0, button, touch: pointerType === "touch" });
    };
    for (const kind of /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"])) element.addEventListener(kind, hear);
    element.addEventListener("wheel", hear, { passive: false });
  }
}
