// Controls of a 3D view: pointers and wheels on it, the menu of sides, the button for the path, and the scale of
// the colours.
import { get } from "../lib/text.js";
import { Player } from "../player/player.js";
import { Sketch } from "./sketch.js";
import { Stage, StandIn } from "./stage.js";

const MOVED_PX = 4; // a pointer that moves less clicks
const TURN_RAD = 2 * Math.PI; // for a way as long as the view is high
const ZOOM_PER_PX = 0.0012; // of a wheel, as an exponent
const MAX_WHEEL_PX = 400; // of one event
const QUARTER = Math.PI / 2;
/** @type {Record<string, [azimuth: number, elevation: number]>} */
const SIDES = { front: [-QUARTER, 0], right: [0, 0], back: [QUARTER, 0], left: [Math.PI, 0], top: [-QUARTER, QUARTER], below: [-QUARTER, -QUARTER] };

/** @typedef {{ x: number, y: number, fromX: number, fromY: number, button: number, drags: boolean }} Finger */

// Pointers on a view, which move the camera. One turns it, with the right or the middle button it moves the
// picture; two zoom, and move the picture unless the chain is followed.
export class Hand {
  /**
   * @param {(orbit: Orbit) => void} does
   * @param {{ height: () => number, follows: () => boolean }} view its height in pixels
   */
  constructor(does, { height, follows }) {
    this.does = does;
    this.height = height;
    this.follows = follows;
    /** @type {Map<number, Finger>} */
    this.fingers = new Map();
  }

  /** @param {Pointer} pointer */
  hear({ kind, id, x, y, by, button }) {
    const { fingers } = this;
    if (kind === "pointerdown") fingers.set(id, { x, y, fromX: x, fromY: y, button, drags: false });
    else if (kind === "pointerup" || kind === "pointercancel") fingers.delete(id);
    else if (kind === "wheel") this.does({ zoom: Math.exp(ZOOM_PER_PX * Math.min(MAX_WHEEL_PX, Math.max(-MAX_WHEEL_PX, by))) });
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
    finger.drags ||= Math.hypot(x - finger.fromX, y - finger.fromY) > MOVED_PX;
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
      const { type: kind, clientX: x, clientY: y, button } = event;
      const id = "pointerId" in event ? event.pointerId : 0;
      if (kind === "pointerdown" && "pointerId" in event) element.setPointerCapture(id);
      if (kind === "wheel") event.preventDefault();
      this.hear({ kind, id, x, y, by: "deltaY" in event ? event.deltaY : 0, button });
    };
    for (const kind of /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"])) element.addEventListener(kind, hear);
    element.addEventListener("wheel", hear, { passive: false });
  }
}

// A player of a timeline on a 3D view, which pointers move, and on the drawing that stands in for it.
/**
 * @param {import("../player/timeline.js").Timeline} timeline
 * @param {HTMLIFrameElement} frame
 * @param {HTMLCanvasElement} canvas
 * @param {{ calm: boolean, onFirst?: () => void, onScroll?: () => void, pauseMs?: () => number }} options `onFirst` is called with
 *   the first drawing, `onScroll` when the page around an embed scrolls
 */
export function playerOn(timeline, frame, canvas, { calm, onFirst, onScroll, pauseMs }) {
  const sketch = new Sketch(canvas, onFirst);
  const stage = new Stage(frame, {
    open: () => standIn.takeOver(), pick: (origin, direction) => player.pick(origin, direction), pointer: (pointer) => hand.hear(pointer), scroll: onScroll, lost: () => { standIn.fallBack(); player.show(true); },
  });
  const standIn = new StandIn(canvas, stage, sketch);
  /** @type {Player} */
  const player = new Player(timeline, { stage, standIn, sketch, aspect: () => frame.clientWidth / Math.max(1, frame.clientHeight), calm, pauseMs });
  const hand = new Hand((orbit) => player.send({ do: "orbit", ...orbit }), { height: () => Math.max(1, frame.clientHeight), follows: () => player.is.follow });
  hand.on(canvas);
  new ResizeObserver(() => player.show(true)).observe(frame);
  return { player, stage, sketch, standIn };
}

// The menu of the sides from which a fold can be seen.
/** @param {Pick<Playing, "send">} player */
export function offerSides(player) {
  const menu = get("sides");
  menu.onchange = () => {
    const side = SIDES[menu.value];
    const camera = side ? { azimuth: side[0], elevation: side[1], zoom: 1, aside: null } : null;
    menu.value = "";
    player.send({ do: "camera", camera, gently: true });
  };
}

// The button that shows the path of the chain through see-through modules.
/** @param {import("./stage.js").Stage[]} stages */
export function pathButton(stages) {
  const button = get("through");
  const path = {
    on: false,
    changed: () => {},
    set(/** @type {boolean} */ on) {
      if (on === path.on) return;
      path.on = on;
      button.setAttribute("aria-pressed", String(on));
      for (const stage of stages) stage.seeThrough(on);
      path.changed();
    },
  };
  button.onclick = () => path.set(!path.on);
  return path;
}

// The scale of a colouring, in numbers.
/**
 * @param {import("../player/colours.js").Colouring} chosen
 * @param {import("../player/timeline.js").Timeline} timeline
 */
export function showScale(chosen, timeline) {
  const { low, high, ramp, none } = chosen.legend();
  get("legend").hidden = false;
  get("legend").style.setProperty("--unknown", `rgb(${timeline.bundle.header.colours.unknown.join(" ")})`);
  get("legend-low").textContent = low;
  get("legend-high").textContent = high;
  get("legend-ramp").style.background = ramp;
  get("legend-none").hidden = !none;
  const meaning = get("legend-none").lastElementChild;
  if (meaning) meaning.textContent = none;
}
