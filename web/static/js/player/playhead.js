// Position in a timeline and its motion. A message has one verb, `do`:
//   play, pause, toggle           run or stop; play at the end starts over
//   seek {frame} or {percent}     go there and stop
//   step {by}                     go whole frames back or forward, and stop
//   set {speed, loop, reverse, follow, turn, live, real}
//                                 any of them; real plays in real time of the robot
//   set {from, to}                loop from one frame to another; null for the end of the timeline
import { angleIn, differing } from "./frames.js";

const SPEEDS = [0.05, 20];
const SWITCHES = /** @type {const} */ (["loop", "reverse", "follow", "turn", "live", "real"]);
const WHOLE_PLAYBACK_S = 20;
const SLOWEST_FPS = 12;
// A long timeline takes longer; otherwise its modules would move too fast to see.
const FASTEST_FPS = 240;
const CATCH_UP_S = 0.4;
const HOLD_S = 1.2;
const SEEN_RAD = 0.05; // smallest visible rotation of a hinge

/** @typedef {import("./timeline.js").Timeline} Timeline */

export class Playhead {
  // `timeline` provides its `last` frame and whether it is `growing`.
  /** @param {{ last: number, growing: boolean, row?: Timeline["row"] }} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.frame = 0;
    this.hold = 0;
    /** @type {{ framesPerSecond: number | null } | null} determines the pace unless that is null */
    this.story = null;
    /** @type {Switches} */
    this.is = {
      playing: false,
      speed: 1,
      loop: false,
      reverse: false,
      follow: true,
      turn: false,
      live: false,
      real: false,
      from: null,
      to: null,
    };
  }

  // Execute a message. Return true if its verb is known.
  /** @param {Command} message */
  do(message) {
    const { is, timeline } = this;
    switch (message.do) {
      case "play":
      case "pause":
      case "toggle":
        this.run(message.do === "toggle" ? !is.playing : message.do === "play");
        return true;
      case "seek":
        this.go("percent" in message ? (message.percent / 100) * timeline.last : message.frame);
        return true;
      case "step":
        this.go(
          (message.by > 0 ? Math.floor(this.frame + 1e-9) : Math.ceil(this.frame - 1e-9)) +
            message.by,
        );
        return true;
      case "set":
        if (message.speed !== undefined)
          Object.assign(is, {
            speed: Math.min(Math.max(message.speed, SPEEDS[0]), SPEEDS[1]),
            real: false,
          });
        if (message.live && !is.live) is.playing = false;
        for (const name of SWITCHES) is[name] = message[name] ?? is[name];
        this.loopOver(message);
        return true;
      default:
        return false;
    }
  }

  /** @param {number} frame */
  go(frame) {
    this.frame = Math.min(Math.max(frame, 0), this.timeline.last);
    Object.assign(this.is, { playing: false, live: false });
  }

  // Set the ends of the loop. An end at that of the timeline
  // becomes null; if both ends cross, the older one becomes null.
  /** @param {Partial<Pick<Switches, "from" | "to">>} message */
  loopOver({ from, to }) {
    const {
      is,
      timeline: { last, growing },
    } = this;
    if (from !== undefined)
      is.from = from !== null && from > 0 && (from < last || growing) ? from : null;
    if (to !== undefined) is.to = to !== null && to > 0 && (to < last || growing) ? to : null;
    if (is.from !== null && is.to !== null && is.from >= is.to)
      is[from === undefined || from === null ? "from" : "to"] = null;
    if ((from !== undefined || to !== undefined) && (is.from !== null || is.to !== null))
      is.loop = true;
  }

  // First and last frame of the range that is played.
  get range() {
    const {
      is: { loop, from, to },
      timeline: { last },
    } = this;
    return loop && (from ?? 0) < last ? [from ?? 0, Math.min(to ?? last, last)] : [0, last];
  }

  /** @param {boolean} playing */
  run(playing) {
    const { is, timeline } = this;
    const [first, last] = this.range;
    const over = this.frame >= last - 1e-6 && !(timeline.growing && last === timeline.last);
    if (playing && !is.reverse && (over || this.frame < first)) this.frame = first;
    if (playing && is.reverse && (this.frame <= first + 1e-6 || this.frame > last))
      this.frame = last;
    this.hold = 0;
    Object.assign(is, { playing, live: false });
  }

  // Advance by the seconds that passed until `now`. Return true if the playhead moved.
  /**
   * @param {number} passed
   * @param {number} now
   */
  advance(passed, now) {
    const { is, timeline } = this;
    if (is.live) {
      const gap = timeline.last - this.frame;
      this.frame =
        gap < 0.6 ? timeline.last : this.frame + gap * (1 - Math.exp(-passed / CATCH_UP_S));
      if (!timeline.growing && this.frame >= timeline.last) is.live = false;
      return true;
    }
    if (!is.playing || now < this.hold) return false;
    // In real time: the number of frames that the robot needs so many seconds for; 0 at the end.
    const robot =
      is.real && timeline.row && !this.story?.framesPerSecond
        ? /** @type {Timeline} */ (timeline)
        : null;
    const real = robot
      ? Math.abs(after(robot, this.frame, is.reverse ? -passed : passed) - this.frame)
      : 0;
    this.runOn(real || passed * this.framesPerSecond * is.speed, now);
    return true;
  }

  get framesPerSecond() {
    return (
      this.story?.framesPerSecond ??
      Math.min(FASTEST_FPS, Math.max(SLOWEST_FPS, (this.timeline.last + 1) / WHOLE_PLAYBACK_S))
    );
  }

  /**
   * @param {number} by
   * @param {number} now
   */
  runOn(by, now) {
    const { is, timeline } = this;
    const frame = this.frame + (is.reverse ? -by : by);
    const [first, last] = this.range;
    if (frame >= first && frame <= last) {
      this.frame = frame;
      return;
    }
    const end = is.reverse ? first : last;
    if (!is.loop) {
      this.frame = end;
      is.playing = timeline.growing && !is.reverse;
    } else if (this.frame !== end) {
      this.hold = now + HOLD_S;
      this.frame = end;
    } else {
      this.frame = first + last - end;
    }
  }
}

// Steps in seconds and in visible changes.

// Return the fractional frame at some seconds from a frame. Frames
// that are not loaded count as long as the last loaded one.
/**
 * @param {Timeline} timeline
 * @param {number} frame
 * @param {number} seconds
 */
export function after(timeline, frame, seconds) {
  const way = Math.sign(seconds);
  const end = way > 0 ? timeline.last : 0;
  let position = frame;
  let remainingS = Math.abs(seconds);
  let length = 0; // duration of a frame, in seconds
  while (remainingS > 1e-9 && position !== end) {
    const low = way > 0 ? Math.floor(position) : Math.ceil(position) - 1;
    const [a, b] = [timeline.row(low), timeline.row(low + 1)];
    if (a && b) length = b.time_s - a.time_s;
    // Durations are unknown.
    else if (!length) return Math.min(Math.max(position + way, 0), timeline.last);
    // Fraction of this frame that is still ahead.
    const share = way > 0 ? low + 1 - position : position - low;
    if (share * length > remainingS) return position + (way * remainingS) / length;
    remainingS -= share * length;
    position = way > 0 ? low + 1 : low;
  }
  return position;
}

// Return the next frame (`way` 1: forward, −1: back) at which a hinge has visibly turned or another
// phase begins; otherwise the end of the timeline. A search stops at a frame that is not loaded; to
// continue it, pass that frame and the returned `from`.
/**
 * @param {Timeline} timeline
 * @param {number} frame
 * @param {number} way
 * @param {Row | null} from
 * @returns {{ frame: number, from: Row | null }}
 */
export function nextChange(timeline, frame, way, from = null) {
  const { last } = timeline;
  const firstRow = way > 0 ? Math.floor(frame) : Math.ceil(frame);
  const start = from ?? timeline.row(firstRow);
  let k = from ? firstRow : firstRow + way;
  for (; start && k > 0 && k < last; k += way) {
    const row = timeline.row(k);
    if (!row) return { frame: k, from: start };
    if (row.phase !== start.phase) break;
    const [first, end] = differing(start, row);
    let turned = 0;
    for (let j = first; j < end && turned <= SEEN_RAD; j++)
      turned = Math.abs(angleIn(row, j) - angleIn(start, j));
    if (turned > SEEN_RAD) break;
  }
  return { frame: Math.min(Math.max(k, 0), last), from: null };
}
