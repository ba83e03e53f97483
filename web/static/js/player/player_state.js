// State of a player, without drawing or clock: the playhead, the displayed moment, the selected and
// marked modules and their colours, and the reports about them.
import { frameFolded } from "./kinematics.js";
import { Playhead, after, nextChange } from "./playhead.js";
import { Story } from "./story.js";
import { Emitter } from "./timeline.js";

const BESIDE = 0.4; // fraction of blue in the neighbours of the selected module

// Return the name of a hinge, as in planner/chain/module.py.
/**
 * @param {Chain} chain
 * @param {number} j
 */
function nameOf({ rigid_links: rigid, hinge_names: names }, j) {
  const hinge = names[j % names.length];
  return `joint_${rigid + Math.floor(j / names.length)}${hinge && `_${hinge}`}`;
}

// Return the largest joint error of a moment; null if none is recorded.
/** @param {Pick<Snapshot, "errors">} snapshot */
export function largestError({ errors }) {
  let largest = -1;
  for (const error of errors) if (Math.abs(error) > largest) largest = Math.abs(error);
  return largest < 0 ? null : largest;
}

// Return the colours of all modules during a step: calm, except for the part that moves and the
// modules at whose joints it turns.
/**
 * @param {number} modules
 * @param {Pick<PlanStep, "joints" | "moving">} step
 * @param {{ calm: Colour, moving: Colour, joint: Colour }} colours
 */
export function partColours(modules, { joints, moving }, { calm, moving: turned, joint }) {
  const colours = new Uint8Array(3 * modules);
  for (let i = 0; i < modules; i++)
    colours.set(moving.some(([first, last]) => first <= i && i <= last) ? turned : calm, 3 * i);
  for (const module of joints) colours.set(joint, 3 * module);
  return colours;
}

export class PlayerState extends Emitter {
  /** @type {import("./colours.js").Colouring | null} */
  colouring = null;
  /** @type {number | null} */
  selected = null;
  /** @type {number[]} */
  marked = [];
  /** @type {"stuck" | "selected"} */
  markedAs = "stuck";
  /** @type {TurningPart | null} part that turns in a step, in place of the colouring */
  turning = null;
  /**
   * @type {{ way: number, from: Row } | null} search for a change that continues in frames that are
   *   not loaded yet
   */
  search = null;
  /** @type {Snapshot | null} */
  snapshot = null;

  /**
   * @param {import("./timeline.js").Timeline} timeline
   * @param {boolean} calm true if nothing starts to play by itself
   */
  constructor(timeline, calm) {
    super();
    this.timeline = timeline;
    this.playhead = new Playhead(timeline);
    this.story = this.playhead.story = new Story(this.playhead, timeline, calm);
  }

  // Initialise the state when the timeline begins.
  begin() {
    const { timeline, playhead } = this;
    if (this.selected !== null && this.selected >= timeline.chain.modules) this.selected = null;
    if (timeline.growing && playhead.is.live) playhead.frame = timeline.last;
    else this.story.begun();
    playhead.frame = Math.min(playhead.frame, timeline.last);
  }

  // Convert a step in seconds, progress or changes to a seek.
  /**
   * @param {Command} message
   * @returns {Command}
   */
  sought(message) {
    const {
      timeline,
      search,
      playhead: { frame },
    } = this;
    this.search = null;
    if (message.do === "pass")
      return { do: "seek", frame: after(timeline, frame, message.seconds) };
    if (message.do === "fold")
      return { do: "seek", frame: frameFolded(timeline, message.percent / 100) ?? frame };
    if (message.do !== "change") return message;
    if (search?.way === message.way && !timeline.row(frame)) {
      this.search = search;
      return { do: "seek", frame };
    }
    return { do: "seek", frame: this.changeFrom(frame, message.way) };
  }

  /**
   * @param {number} frame
   * @param {number} way
   * @param {Row | null} start row where a continued search began
   */
  changeFrom(frame, way, start = null) {
    const { frame: changeFrame, from } = nextChange(this.timeline, frame, way, start);
    this.search = from && { way, from };
    return changeFrame;
  }

  // Continue a search whose frame is now loaded. Return true if there was one.
  searchOn() {
    const {
      search,
      timeline,
      playhead: { frame },
    } = this;
    if (!search || !timeline.row(frame)) return false;
    return this.playhead.do({ do: "seek", frame: this.changeFrom(frame, search.way, search.from) });
  }

  /** @param {number | null} module */
  setSelected(module) {
    const exists = module === null || (module >= 0 && module < this.timeline.chain.modules);
    if (exists) this.selected = module;
    return exists;
  }

  // Return the state at the playhead: phase, error, progress of folding, pace.
  /**
   * @param {Snapshot} snapshot
   * @returns {State}
   */
  report(snapshot) {
    const { timeline, playhead } = this;
    return {
      ...playhead.is,
      frame: playhead.frame,
      frames: timeline.total,
      growing: timeline.growing,
      time_s: snapshot.time_s,
      phase: snapshot.phase,
      error_rad: largestError(snapshot),
      folded: Math.round(1000 * timeline.folded(snapshot)) / 1000,
      pace: this.paceAt(snapshot),
    };
  }

  // Return the seconds of robot time per second of playback; null while no robot moves.
  /** @param {Snapshot} snapshot */
  paceAt({ low, phase, exact }) {
    const { timeline, playhead, story } = this;
    const { real, speed } = playhead.is;
    if (phase === "explosion" || !exact || story.telling) return null;
    if (real) return 1;
    const first = Math.min(low, Math.max(0, timeline.last - 1));
    const [a, b] = [timeline.row(first), timeline.row(first + 1)];
    return a && b && a.phase === b.phase && b.time_s > a.time_s
      ? (b.time_s - a.time_s) * playhead.framesPerSecond * speed
      : null;
  }

  get outline() {
    const { timeline } = this;
    return {
      ...timeline.outline,
      frames: timeline.total,
      growing: timeline.growing,
      modules: timeline.chain.modules,
    };
  }

  // The selected module and its joint at the displayed moment.
  /** @returns {ModuleTold | { index: null }} */
  get module() {
    const { timeline, snapshot, selected: index } = this;
    if (index === null || !snapshot) return { index: null };
    const { chain } = timeline;
    const first = (index - chain.rigid_links) * chain.hinges;
    const columns =
      first >= 0 && first < timeline.joints
        ? Array.from({ length: chain.hinges }, (_, k) => first + k)
        : [];
    const at = timeline.bundle.arrays.folded_positions;
    return {
      index,
      modules: chain.modules,
      snapshot,
      cell: chain.cells ? [0, 1, 2].map((k) => Math.round(at[3 * index + k])) : null,
      joints: columns.map((j) => ({
        name: nameOf(chain, j),
        column: j,
        angle_rad: snapshot.angle(j),
        target_rad: timeline.foldedRad[j],
        error_rad: Number.isNaN(snapshot.errors[j]) ? null : Math.abs(snapshot.errors[j]),
      })),
    };
  }

  // Return the colours of all modules, including highlights of
  // the selected module, its neighbours and the marked modules.
  colours() {
    if (!this.colouring || !this.snapshot) return new Uint8Array(0);
    const { selected, turning } = this;
    const { selected: blue, stuck, unknown } = this.timeline.bundle.header.colours;
    const colours = turning
      ? partColours(this.timeline.chain.modules, turning, {
          calm: unknown,
          moving: blue,
          joint: stuck,
        })
      : this.colouring.of(this.snapshot);
    for (const module of this.marked)
      colours.set(this.markedAs === "selected" ? blue : stuck, 3 * module);
    if (selected === null) return colours;
    for (const beside of [selected - 1, selected + 1]) {
      if (beside < 0 || beside >= this.timeline.chain.modules) continue;
      for (let c = 0; c < 3; c++)
        colours[3 * beside + c] += (blue[c] - colours[3 * beside + c]) * BESIDE;
    }
    colours.set(blue, 3 * selected);
    return colours;
  }
}
