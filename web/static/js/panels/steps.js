// The steps of a plan that rests between turns: next and back, with the moving part in colour.
import { get } from "../lib/text.js";
import { addStyle } from "../lib/lazy_styles.js";
import { heldStill } from "../player/kinematics.js";
import { across, axesOf, dot, framing } from "../viewer/camera.js";
import { clearestSight, isHidden } from "../viewer/viewpoint.js";
import { frameBetween, movingSeconds } from "../tour/state.js";

const STYLE = "/static/css/tour.css";
const SLACK = 0.5; // frames; a larger deviation means that the visitor has moved the playhead
// Extent of the chain in a new view, as a fraction of the free part of the picture.
const EXTENT = 0.86;
const MIN_EXTENT = 0.4; // with a smaller extent, the camera moves nearer
// Modules of a straight end that stay in the picture, beside the last bend or joint.
const KEPT_ENDS = 10;
// Largest fraction of the picture's height that counts as covered by the panel.
const MAX_COVERED = 0.5;

/**
 * @typedef {<Made>(use: (panel: StepsPanel) => Made) => Promise<Made | undefined>} Stepping loads
 *   the panel on first use
 */

// Return how many steps are done at a frame; during a step, it is not done.
/**
 * @param {PlanStep[]} steps
 * @param {number} frame
 */
export const stepsDone = (steps, frame) => steps.filter(({ end }) => end <= frame + SLACK).length;

// Return the text for a number of steps that are done: the next step, or that all are done.
/**
 * @param {PlanStep[]} steps
 * @param {number} done
 */
export const stepWords = (steps, done) =>
  done < steps.length
    ? { count: `Step ${done + 1} of ${steps.length}`, text: steps[done].text }
    : { count: `All ${steps.length} steps`, text: "The chain is folded." };

// Return the modules to look at in a step: the bent part of the chain and the joints that turn. Of
// long straight ends, only the beginning: the joints would be too small to be seen beside the whole
// chain.
/**
 * @param {ArrayLike<number>} positions
 * @param {number[]} joints
 */
export function modulesInView(positions, joints) {
  const count = positions.length / 3;
  let [first, last] = joints.length ? [Math.min(...joints), Math.max(...joints)] : [0, count - 1];
  for (let i = 1; i < count - 1; i++) {
    const isBent = [0, 1, 2].some(
      (k) =>
        Math.abs(positions[3 * i + 3 + k] - 2 * positions[3 * i + k] + positions[3 * i - 3 + k]) >
        0.1,
    );
    if (isBent) [first, last] = [Math.min(first, i), Math.max(last, i)];
  }
  if (first < 2 * KEPT_ENDS) first = 0;
  else first -= KEPT_ENDS;
  if (count - last <= 2 * KEPT_ENDS) last = count - 1;
  else last += KEPT_ENDS;
  return Array.from({ length: last - first + 1 }, (_, k) => first + k);
}

// Return the extent of some points in the free part of the picture, above what is covered: 1 if
// they touch its edge.
/**
 * @param {Vector[]} points
 * @param {View} view
 * @param {{ field: number, aspect: number, covered: number }} picture
 */
export function extent(
  points,
  { target, azimuth, elevation, distance },
  { field, aspect, covered },
) {
  const [right, up, out] = axesOf(azimuth, elevation);
  const tall = Math.tan(field / 2);
  let largest = 0;
  for (const p of points) {
    const off = /** @type {Vector} */ (p.map((v, k) => v - target[k]));
    const depth = Math.max(distance - dot(off, out), 1e-3 * distance);
    const [x, y] = [dot(off, right) / (depth * tall * aspect), dot(off, up) / (depth * tall)];
    largest = Math.max(largest, Math.abs(x), Math.abs(y - covered) / (1 - covered));
  }
  return largest;
}

export class StepsPanel {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {PlanStep[]} steps
   * @param {boolean} calm true if steps are shown without an animation
   */
  constructor(player, steps, calm) {
    this.player = player;
    this.steps = steps;
    this.calm = calm;
    this.done = 0; // steps that are done
    /**
     * @type {{ from: number, to: number, begun: number, seconds: number, frame: number,
     *   done: number } | null}
     */
    this.way = null;
    this.follow = true; // as before the panel was opened
    this.box = get("steps-panel");
    get("steps-next").onclick = () => this.step(1);
    get("steps-before").onclick = () => this.step(-1);
    get("steps-close").onclick = () => this.close();
    addStyle(STYLE);
    addEventListener("keydown", (event) => this.key(event));
    player.on("state", (/** @type {State} */ { frame }) => this.moved(frame));
  }

  get open() {
    return !this.box.hidden;
  }

  // Show the step at the playhead; at the end of the fold, begin with the first one.
  begin() {
    const { player, steps } = this;
    if (!get("tour-panel").hidden) get("tour-close").click();
    this.follow = player.is.follow;
    this.box.hidden = false;
    get("steps").setAttribute("aria-expanded", "true");
    player.send({ do: "pause" });
    player.send({ do: "set", from: null, to: null, loop: false, reverse: false });
    const done = stepsDone(steps, player.playhead.frame);
    this.show(done === steps.length ? 0 : done, true);
    get("steps-next").focus();
  }

  close() {
    this.way = null;
    this.box.hidden = true;
    this.player.turnPart(null);
    this.player.send({ do: "set", follow: this.follow });
    get("steps").setAttribute("aria-expanded", "false");
    get("steps").focus();
  }

  // Make the next step, or take the last one back.
  /** @param {number} by */
  step(by) {
    const { way, steps, player } = this;
    if (way) this.show(way.done); // the visitor does not wait for the end of a motion
    const done = this.done + by;
    if (done < 0 || done > steps.length) return;
    if (this.calm) {
      this.show(done);
      return;
    }
    const { start, end } = steps[Math.min(done, this.done)];
    const [from, to] = by > 0 ? [start, end] : [end, start];
    this.done = Math.min(done, this.done);
    this.say();
    this.way = {
      from,
      to,
      begun: performance.now(),
      seconds: movingSeconds(to - from),
      frame: from,
      done,
    };
    player.send({ do: "seek", frame: from });
    this.move();
  }

  move() {
    const { way, player } = this;
    if (!way) return;
    const share = (performance.now() - way.begun) / 1000 / way.seconds;
    if (share >= 1) {
      this.show(way.done);
      return;
    }
    way.frame = frameBetween(way.from, way.to, share);
    player.send({ do: "seek", frame: way.frame });
    requestAnimationFrame(() => {
      if (this.way === way) this.move();
    });
  }

  // Show the chain at rest after some steps.
  /**
   * @param {number} done
   * @param {boolean} first true if the panel has just been opened
   */
  show(done, first = false) {
    const { player, steps } = this;
    this.way = null;
    this.done = done;
    player.send({
      do: "seek",
      frame: done < steps.length ? steps[done].start : steps[done - 1].end,
    });
    this.say();
    this.look(first);
  }

  // Keep the camera where it is, unless the joint is hidden, what matters is too large or too
  // small, or the chain is folded.
  /** @param {boolean} first */
  look(first) {
    const { player, steps, done } = this;
    const { rig, snapshot, timeline } = player;
    const { view } = rig;
    if (!snapshot || !view) return;
    const isFolded = done === steps.length;
    const { joints, end, held } = steps[Math.min(done, steps.length - 1)];
    const after = timeline.peek(end);
    const modules = modulesInView(snapshot.positions, isFolded ? [] : joints);
    const points = [snapshot, after ? heldStill(after, held) : snapshot].flatMap((pose) =>
      rig.points(pose, modules),
    );
    const seeing = rig.seeing(null);
    const { field, aspect } = seeing;
    const covered = Math.min(
      this.box.offsetHeight / Math.max(1, get("main").clientHeight),
      MAX_COVERED,
    );
    const size = (/** @type {View} */ from) => extent(points, from, { field, aspect, covered });
    const hidden =
      !isFolded &&
      joints.every((module) =>
        isHidden(snapshot.positions, module, [view.azimuth, view.elevation]),
      );
    if (!first && !isFolded && !hidden && size(view) <= 1 && size(view) >= MIN_EXTENT) return;
    const [azimuth, elevation] = hidden
      ? clearestSight(snapshot.positions, joints, [view.azimuth, view.elevation])
      : [view.azimuth, view.elevation];
    const middle = framing(points, { ...seeing, radius: rig.pitch, azimuth, elevation });
    const down = -covered * Math.tan(field / 2); // the panel covers the lower part of the picture
    const placed = (/** @type {number} */ distance) => ({
      ...middle,
      distance,
      target: across({ ...middle, distance }, 0, down),
    });
    let camera = placed(middle.distance);
    for (let round = 0; round < 4; round++)
      camera = placed((camera.distance * size(camera)) / EXTENT);
    player.send({ do: "set", follow: false });
    player.send({ do: "camera", camera: rig.relative(camera, snapshot), gently: !this.calm });
  }

  say() {
    const { steps, done, player } = this;
    const { count, text } = stepWords(steps, done);
    get("steps-count").textContent = count;
    get("steps-text").textContent = text;
    get("steps-before").disabled = done === 0;
    get("steps-next").disabled = done === steps.length;
    get("steps-key").hidden = done === steps.length;
    const { held } = steps[Math.min(done, steps.length - 1)];
    player.turnPart(done < steps.length ? steps[done] : { joints: [], moving: [], held });
  }

  // The visitor has moved the playhead: tell the step there.
  /** @param {number} frame */
  moved(frame) {
    if (!this.open || (this.way && Math.abs(frame - this.way.frame) <= SLACK)) return;
    this.way = null;
    const done = stepsDone(this.steps, frame);
    if (done === this.done) return;
    this.done = done;
    this.say();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (
      !this.open ||
      event.defaultPrevented ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      document.querySelector("dialog[open]")
    )
      return;
    if (
      event.target instanceof Element &&
      event.target.closest("textarea, input, select, [role=slider], #panel-plots")
    )
      return;
    const by = { PageUp: -1, PageDown: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    this.step(by);
  }
}
