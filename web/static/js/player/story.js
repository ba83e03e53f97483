// The story of a fold that is computed while its page is open. As soon as there are frames, the
// explosion plays at a pace that can be watched; then the fold plays. When the fold is over (see
// "settled" of timeline.js), the fold plays from straight to folded and rests on the finished shape.
// A visitor who goes to a frame, plays or pauses ends the story; one who turns the view or selects a
// module sees the motion go on, without a jump back to the straight chain at the end.

// Seconds that a phase takes, however many frames it has. Chosen.
const EXPLOSION_S = 5;
const FOLD_S = 8;
/** Minimum pace in frames per second; a phase of few frames takes less time. Chosen. */
const MIN_FPS = 12;
/** Maximum pace of a long timeline, whose frames are fetched while they are played. Chosen. */
const MAX_WINDOWED_FPS = 240;
/** Seconds to the newest frame within which the pace drops, so that the motion does not stop dead. Chosen. */
const SLOWING_S = 0.4;
/** Seconds in which the pace reaches most of a change. Chosen. */
const SMOOTHING_S = 0.3;
/** Seconds for which the straight chain rests before it folds. Chosen. */
const REST_S = 0.6;
const END = 1e-6; // frames that count as none
/** Frames to the newest one below which the motion stops, so that nothing is drawn while it waits. Chosen. */
const STILL = 0.05;
const ENDING = new Set(["seek", "step", "pass", "change", "fold", "play", "pause", "toggle"]);

/** @typedef {"before" | "telling" | "finale" | "over"} Part */
/** @typedef {Pick<import("./timeline.js").Timeline, "last" | "growing" | "over" | "outline" | "windowed">} Told */

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
    this.looking = false; // the visitor turned the view or selected a module
    this.waited = false; // the fold stood still for want of frames
    this.rest = 0;
    /** @type {string | undefined} */
    this.phase = undefined;
    this.pace = 0;
  }

  // True while the story decides what is shown.
  get telling() { return this.part === "telling" || this.part === "finale"; }

  // A timeline is there; once more if it is begun anew.
  begun() {
    if (this.part === "over" || (this.part === "before" && this.timeline.over)) return;
    this.play("telling", 0);
  }

  /** @param {Command} message */
  heard(message) {
    // An address without a loop sets its ends to null, which is no act of a visitor.
    if (ENDING.has(message.do) || (message.do === "set" && (message.live || message.reverse || message.from != null || message.to != null))) this.end();
    else if (message.do === "orbit" || (message.do === "select" && message.module !== null)) this.looking = true;
  }

  // Nothing more comes.
  settled() {
    if (!this.telling) return;
    const { playhead, timeline, folding } = this;
    if (this.calm) {
      playhead.frame = timeline.last;
      this.end();
      return;
    }
    const shown = this.waited || playhead.frame >= timeline.last - END;
    if (shown && this.looking) playhead.is.playing = playhead.frame < timeline.last - END;
    else if (shown && folding) { this.play("finale", folding.from); return; }
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

  end() { this.part = "over"; }

  get folding() { return this.timeline.outline.phases.findLast(({ name }) => name === "playback"); }

  // Lets seconds pass. The playhead, which `framesPerSecond` moves, comes after.
  /** @param {number} passed */
  advance(passed) {
    if (!this.telling) return;
    const { playhead: { frame }, timeline } = this;
    const phase = timeline.outline.phases.find(({ to }) => frame < to - 1 + END) ?? timeline.outline.phases.at(-1);
    if (!phase) return;
    if (phase.name !== this.phase) {
      if (phase.name === "playback") { this.rest = REST_S; this.pace = 0; }
      this.phase = phase.name;
    }
    this.rest -= passed;
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
    const most = timeline.windowed ? MAX_WINDOWED_FPS : Infinity;
    return Math.min(pace, most, timeline.growing ? gap / SLOWING_S : Infinity);
  }

  // The pace of the playhead; null where the story does not decide it.
  get framesPerSecond() { return this.telling ? (this.rest > 0 ? 0 : this.pace) : null; }
}
