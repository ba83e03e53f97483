// Automatic playback of a fold that is computed while its page is open. As soon as
// there are frames, the explosion plays at a watchable pace; then the fold plays.
// When the fold is over (event "settled" of timeline.js), it plays once more from
// straight to folded and rests on the finished shape. A visitor who goes to a frame,
// plays or pauses ends the story. If the visitor turns the view or selects a module,
// the motion continues, without a jump back to the straight chain at the end.

// Duration of a phase in seconds, independent of its number of frames.
const EXPLOSION_S = 5;
const FOLD_S = 8;
/** Minimum pace in frames per second; phases of few frames, such as turns, take less time. */
const MIN_FPS = 4;
/** Maximum pace of a long timeline, whose frames are fetched while they are played. */
const MAX_WINDOWED_FPS = 240;
/**
 * Seconds before the newest frame within which the pace
 * drops, so that the motion does not stop abruptly.
 */
const SLOWING_S = 0.4;
/** Time constant of changes of the pace, in seconds. */
const SMOOTHING_S = 0.3;
/** Seconds for which the straight chain rests before it folds. */
const REST_S = 0.6;
const END = 1e-6; // tolerance in frames
/**
 * Distance in frames to the newest frame at which the motion
 * stops, so that nothing is drawn while it waits.
 */
const STILL = 0.05;
const ENDING = new Set(["seek", "step", "pass", "change", "fold", "play", "pause", "toggle"]);

/** @typedef {"before" | "telling" | "finale" | "over"} Part */
/**
 * @typedef {Pick<import("./timeline.js").Timeline,
 *   "last" | "growing" | "over" | "outline" | "windowed">} Told
 */

export class Story {
  // With `calm` nothing plays by itself: the first frame stays until the fold is over.
  /**
   * @param {import("./playhead.js").Playhead} playhead
   * @param {Told} timeline
   * @param {boolean} calm
   */
  constructor(playhead, timeline, calm) {
    this.playhead = playhead;
    this.timeline = timeline;
    this.calm = calm;
    /** @type {Part} */
    this.part = "before";
    this.looking = false; // true once the visitor has turned the view or selected a module
    this.waited = false; // true once the playhead has waited for new frames of the fold
    this.restS = 0;
    /** @type {string | undefined} */
    this.phase = undefined;
    this.pace = 0;
  }

  // True while the story controls the playhead.
  get telling() {
    return this.part === "telling" || this.part === "finale";
  }

  // Start when a timeline begins, or restarts.
  begun() {
    if (this.part === "over" || (this.part === "before" && this.timeline.over)) return;
    this.play("telling", 0);
  }

  /** @param {Command} message */
  heard(message) {
    // An address without a loop sets its ends to null; that is no action of the visitor.
    if (
      ENDING.has(message.do) ||
      (message.do === "set" &&
        (message.live || message.reverse || message.from != null || message.to != null))
    )
      this.end();
    else if (message.do === "orbit" || (message.do === "select" && message.module !== null))
      this.looking = true;
  }

  // Play the finale once the timeline is complete.
  settled() {
    if (!this.telling) return;
    const { playhead, timeline, folding } = this;
    if (this.calm) {
      playhead.frame = timeline.last;
      this.end();
      return;
    }
    const atEnd = this.waited || playhead.frame >= timeline.last - END;
    if (atEnd && this.looking) playhead.is.playing = playhead.frame < timeline.last - END;
    else if (atEnd && folding) {
      this.play("finale", folding.from);
      return;
    }
    this.part = "finale";
  }

  /**
   * @param {Part} part
   * @param {number} frame
   */
  play(part, frame) {
    Object.assign(this, { part, waited: false, rest: 0, pace: MIN_FPS, phase: undefined });
    this.playhead.frame = frame;
    this.playhead.is.playing = !this.calm;
  }

  end() {
    this.part = "over";
  }

  get folding() {
    return this.timeline.outline.phases.findLast(({ name }) => name === "playback");
  }

  // Advance by some seconds, before the playhead, which reads `framesPerSecond`.
  /** @param {number} passed */
  advance(passed) {
    if (!this.telling) return;
    const {
      playhead: { frame },
      timeline,
    } = this;
    const phase =
      timeline.outline.phases.find(({ to }) => frame < to - 1 + END) ??
      timeline.outline.phases.at(-1);
    if (!phase) return;
    if (phase.name !== this.phase) {
      if (phase.name === "playback") {
        this.restS = REST_S;
        this.pace = 0;
      }
      this.phase = phase.name;
    }
    this.restS -= passed;
    const gap = timeline.last - frame;
    if (timeline.growing && phase.name === "playback" && gap < 1) this.waited = true;
    const share = 1 - Math.exp(-passed / SMOOTHING_S);
    this.pace += (this.wanted(phase, gap) - this.pace) * share;
    if (timeline.growing && gap < STILL) this.pace = 0;
    if (!timeline.growing && this.part === "finale" && gap <= END) this.end();
  }

  /**
   * @param {Phase} phase
   * @param {number} gap
   */
  wanted({ name, from, to }, gap) {
    const { timeline } = this;
    const pace = Math.max(MIN_FPS, (to - from) / (name === "playback" ? FOLD_S : EXPLOSION_S));
    const maxPace = timeline.windowed ? MAX_WINDOWED_FPS : Infinity;
    return Math.min(pace, maxPace, timeline.growing ? gap / SLOWING_S : Infinity);
  }

  // Pace of the playhead; null while the story does not control it.
  get framesPerSecond() {
    return this.telling ? (this.restS > 0 ? 0 : this.pace) : null;
  }
}
