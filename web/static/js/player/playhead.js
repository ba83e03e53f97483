// Where a visitor is in a timeline and how that moves. A message has one verb, `do`:
//   play, pause, toggle           run or stop; play at the end starts over
//   seek {frame} or {percent}     go there and stop
//   step {by}                     whole frames back or forward, and stop
//   set {speed, loop, reverse, follow, turn, live}   any of them
const SPEEDS = [0.05, 20];
const SWITCHES = /** @type {const} */ (["loop", "reverse", "follow", "turn", "live"]);
const WHOLE_PLAYBACK_S = 20;
const SLOWEST_FPS = 12;
const FASTEST_FPS = 240; // a long timeline takes longer, else its modules fly by
const CATCH_UP_S = 0.4;
const HOLD_S = 1.2;

export class Playhead {
  // `timeline` tells its `last` frame and whether it is `growing`.
  /** @param {{ last: number, growing: boolean }} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.frame = 0;
    this.coarse = false;
    this.hold = 0;
    /** @type {Switches} */
    this.is = { playing: false, speed: 1, loop: false, reverse: false, follow: true, turn: false, live: false };
  }

  // True when the message was understood.
  /** @param {Command} message */
  do(message) {
    const { is, timeline } = this;
    switch (message.do) {
      case "play": case "pause": case "toggle":
        this.run(message.do === "toggle" ? !is.playing : message.do === "play");
        return true;
      case "seek":
        this.go("percent" in message ? (message.percent / 100) * timeline.last : message.frame);
        return true;
      case "step":
        this.go((message.by > 0 ? Math.floor(this.frame + 1e-9) : Math.ceil(this.frame - 1e-9)) + message.by);
        return true;
      case "set":
        if (message.speed !== undefined) is.speed = Math.min(Math.max(message.speed, SPEEDS[0]), SPEEDS[1]);
        if (message.live && !is.live) is.playing = false;
        for (const name of SWITCHES) is[name] = message[name] ?? is[name];
        return true;
      default: return false;
    }
  }

  /** @param {number} frame */
  go(frame) {
    this.frame = Math.min(Math.max(frame, 0), this.timeline.last);
    Object.assign(this.is, { playing: false, live: false });
  }

  /** @param {boolean} playing */
  run(playing) {
    const { is, timeline } = this;
    if (playing && !is.reverse && this.frame >= timeline.last - 1e-6 && !timeline.growing) this.frame = 0;
    if (playing && is.reverse && this.frame <= 1e-6) this.frame = timeline.last;
    this.hold = 0;
    Object.assign(is, { playing, live: false });
  }

  // Lets seconds pass, up to `now`; true when the playhead has moved.
  /**
   * @param {number} passed
   * @param {number} now
   */
  advance(passed, now) {
    const { is, timeline } = this;
    if (is.live) {
      const gap = timeline.last - this.frame;
      this.frame = gap < 0.6 ? timeline.last : this.frame + gap * (1 - Math.exp(-passed / CATCH_UP_S));
      if (!timeline.growing && this.frame >= timeline.last) is.live = false;
      return true;
    }
    if (!is.playing || now < this.hold) return false;
    this.runOn(passed * this.framesPerSecond * is.speed, now);
    return true;
  }

  get framesPerSecond() { return Math.min(FASTEST_FPS, Math.max(SLOWEST_FPS, (this.timeline.last + 1) / WHOLE_PLAYBACK_S)); }

  /**
   * @param {number} by
   * @param {number} now
   */
  runOn(by, now) {
    const { is, timeline } = this;
    const frame = this.frame + (is.reverse ? -by : by);
    if (frame >= 0 && frame <= timeline.last) {
      // Frames that pass faster than they can be shown need no in-betweens.
      this.coarse = by >= 1;
      this.frame = frame;
      return;
    }
    const end = is.reverse ? 0 : timeline.last;
    if (!is.loop) {
      this.frame = end;
      is.playing = timeline.growing && !is.reverse;
    } else if (this.frame !== end) {
      this.hold = now + HOLD_S;
      this.frame = end;
    } else {
      this.frame = timeline.last - end;
    }
  }

  // The frame to show: a whole one where in-betweens would not be seen.
  get shown() { return this.coarse && this.is.playing ? Math.round(this.frame) : this.frame; }
}
