// The part that is looped over, in the track: two ends that are dragged, or moved by keys.
import { get } from "../lib/text.js";

const FAR = 10; // frames
/** @type {Record<string, number>} */
const STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -FAR, PageUp: FAR, Home: -Infinity, End: Infinity };

/** @typedef {"from" | "to"} End */

export class LoopRange {
  /** @param {Playing} player */
  constructor(player) {
    this.player = player;
    this.last = 0;
    /** @type {Record<End, number>} */
    this.at = { from: 0, to: 0 };
    for (const end of /** @type {const} */ (["from", "to"])) {
      const handle = get(`range-${end}`);
      handle.addEventListener("pointerdown", (event) => { event.preventDefault(); handle.focus(); handle.setPointerCapture(event.pointerId); });
      handle.addEventListener("pointermove", (event) => { if (handle.hasPointerCapture(event.pointerId)) this.move(end, this.frameAt(event.clientX)); });
      handle.addEventListener("keydown", (event) => this.key(end, event));
    }
  }

  /** @param {State} state */
  show({ loop, from, to, frames }) {
    get("range").hidden = !loop || frames < 2;
    if (get("range").hidden) return;
    this.last = frames - 1;
    this.at = { from: Math.min(from ?? 0, this.last), to: Math.min(to ?? this.last, this.last) };
    const part = get("range-part");
    const [left, right] = [(100 * this.at.from) / this.last, 100 - (100 * this.at.to) / this.last];
    part.style.left = get("range-from").style.left = `${left}%`;
    part.style.right = get("range-to").style.right = `${right}%`;
    part.classList.toggle("whole", from === null && to === null);
    for (const end of /** @type {const} */ (["from", "to"])) {
      const handle = get(`range-${end}`);
      const frame = Math.round(this.at[end]) + 1;
      handle.setAttribute("aria-valuemax", String(frames));
      handle.setAttribute("aria-valuenow", String(frame));
      handle.setAttribute("aria-valuetext", `Frame ${frame} of ${frames}`);
    }
  }

  get words() { return get("range").hidden ? "No loop" : `Loop from frame ${Math.round(this.at.from) + 1} to ${Math.round(this.at.to) + 1}`; }

  // An end goes to a frame, and stays a frame away from the other one.
  /**
   * @param {End} end
   * @param {number} frame
   */
  move(end, frame) {
    const [least, most] = end === "from" ? [0, this.at.to - 1] : [this.at.from + 1, this.last];
    this.player.send({ do: "set", [end]: Math.min(Math.max(frame, least), most) });
  }

  /**
   * @param {End} end
   * @param {KeyboardEvent} event
   */
  key(end, event) {
    const by = STEPS[event.key];
    if (by === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation(); // the playhead stays
    this.move(end, this.at[end] + (event.shiftKey ? FAR * by : by));
  }

  /** @param {number} x */
  frameAt(x) {
    const { left, width } = get("track").getBoundingClientRect();
    return Math.round(((x - left) / width) * this.last);
  }
}
