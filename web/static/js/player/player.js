// A visitor's playhead over a timeline, and what follows from it: the pose, its colours, the camera.
//
// It takes the messages of playhead.js and more: select {module} highlights a module, null for none;
// pass {seconds} and change {way} seek a frame by its time, or the next that looks otherwise; orbit
// turns, zooms and moves the view, and camera {camera} sets it, null as usual.
// It tells what is by events: waiting, begun, outline, state, module, camera, drawn, painted.
import { CameraRig, USUAL } from "./camera_rig.js";
import { colouring } from "./colours.js";
import { frameFolded } from "./frames.js";
import { picked } from "../lib/kinematics.js";
import { Playhead, after, nextChange } from "./playhead.js";
import { Story } from "./story.js";
import { Emitter } from "../lib/text.js";

const LONGEST_TICK_S = 0.2;
const TELL_MS = 200;
const USUAL_ASPECT = 1.6;
const BESIDE = 0.4; // how blue the neighbours of the selected module are

// As planner/chain/module.py calls a hinge.
/**
 * @param {Chain} chain
 * @param {number} j
 */
function nameOf({ rigid_links: rigid, hinge_names: names }, j) {
  const hinge = names[j % names.length];
  return `joint_${rigid + Math.floor(j / names.length)}${hinge && `_${hinge}`}`;
}

/** @typedef {import("./timeline.js").Timeline} Timeline */
/** @typedef {import("../viewer/stage.js").Stage} Stage */
/** @typedef {import("../viewer/sketch.js").Sketch} Sketch */

export class Player extends Emitter {
  // Shows on `stage`, for which `standIn` may draw, or on the sketch alone. For who wants little to
  // move, the camera is where a frame that is sought asks for it at once.
  /**
   * @param {Timeline} timeline
   * @param {{ stage?: Stage | null, standIn?: import("../viewer/stage.js").StandIn | null, sketch?: Sketch | null, aspect?: () => number, calm?: boolean, pauseMs?: () => number }} shownOn
   *   `pauseMs` is the minimum time between two pictures of a motion that plays by itself
   */
  constructor(timeline, { stage = null, standIn = null, sketch = null, aspect = () => USUAL_ASPECT, calm = false, pauseMs = () => 0 }) {
    super();
    this.timeline = timeline;
    this.pauseMs = pauseMs;
    this.stage = stage;
    this.sketch = sketch;
    this.standIn = standIn;
    if (this.standIn) {
      this.standIn.busy = () => this.busy;
      this.standIn.painted = () => this.tell("painted", this.shown?.frame);
    }
    this.playhead = new Playhead(timeline);
    this.rig = new CameraRig(timeline, this.playhead, { aspect, calm });
    this.story = this.playhead.story = new Story(this.playhead, timeline, calm);
    /** @type {import("./colours.js").Colouring | null} */
    this.colouring = null;
    /** @type {number | null} */
    this.selected = null;
    /** @type {number[]} */
    this.marked = [];
    /** @type {{ way: number, from: Row } | null} of a change that may lie in frames that are not here yet */
    this.search = null;
    /** @type {Snapshot | null} */
    this.shown = null;
    this.told = "";
    this.toldAt = 0;
    this.lastPlaying = false;
    /** @type {number | null} */
    this.clock = null;
    this.due = false;
    this.tickedMs = 0; // time of the last tick
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.pause = undefined; // before the next tick
    this.gliding = false;
    this.changed = false;
    /** @type {Command[]} */
    this.unheard = []; // what was asked for while a timeline that is begun anew is fetched
    timeline.on("waiting", () => { this.shown = null; this.tell("waiting"); });
    timeline.on("begun", () => this.begin());
    timeline.on("grew", () => this.grew());
    timeline.on("settled", () => { this.story.settled(); this.show(); });
    timeline.on("loaded", () => {
      this.searchOn();
      if (this.shown && (!this.shown.exact || this.rig.approximate)) this.show(true);
    });
    if (timeline.chain) queueMicrotask(() => this.begin());
  }

  // What a message does.

  /**
   * @param {Command} asked
   * @returns {boolean}
   */
  send(asked) {
    if (!this.colouring) return false;
    this.story.heard(asked);
    if (!this.timeline.chain) { this.unheard.push(asked); return true; }
    const message = this.sought(asked);
    const { follow, turn } = this.is;
    if (message.do === "orbit" || message.do === "camera") return this.look(message);
    if (message.do === "set" && "follow" in message) this.lookAt([]);
    if (message.do === "select") this.select(message.module);
    else if (!this.playhead.do(message)) return false;
    if (message.do === "set") {
      if (this.is.follow !== follow || (turn && !this.is.turn)) this.rig.follow(this.is.follow);
      this.aim();
    }
    this.show();
    return true;
  }

  // Steps that are not told in frames, as the frame that they lead to.
  /**
   * @param {Command} message
   * @returns {Command}
   */
  sought(message) {
    const { timeline, playhead: { frame } } = this;
    const { search } = this;
    this.search = null;
    if (message.do === "pass") return { do: "seek", frame: after(timeline, frame, message.seconds) };
    if (message.do === "fold") return { do: "seek", frame: frameFolded(timeline, message.percent / 100) ?? frame };
    if (message.do !== "change") return message;
    if (search?.way === message.way && !timeline.row(frame)) { this.search = search; return { do: "seek", frame }; }
    return { do: "seek", frame: this.changeFrom(frame, message.way) };
  }

  /**
   * @param {number} frame
   * @param {number} way
   * @param {Row | null} start of a search that goes on
   */
  changeFrom(frame, way, start = null) {
    const { frame: found, from } = nextChange(this.timeline, frame, way, start);
    this.search = from && { way, from };
    return found;
  }

  // The frame where it stopped is here now, perhaps.
  searchOn() {
    const { search, timeline, playhead: { frame } } = this;
    if (!search || !timeline.row(frame)) return;
    this.playhead.do({ do: "seek", frame: this.changeFrom(frame, search.way, search.from) });
    this.show();
  }

  get is() { return this.playhead.is; }

  /** @param {number | null} module */
  select(module) {
    if (module !== null && !(module >= 0 && module < this.timeline.chain.modules)) return;
    this.selected = module;
    this.show(true);
    this.tellModule();
  }

  // Modules that stay highlighted.
  /** @param {number[]} modules */
  mark(modules) {
    this.marked = modules.filter((module) => module < this.timeline.chain.modules);
    this.show(true);
  }

  // Turns, zooms or moves the view, or sets it. To move it is to let go of the chain.
  /** @param {Command & { do: "orbit" | "camera" }} message */
  look(message) {
    const { rig, shown, is } = this;
    if (message.do === "camera") {
      if (!message.camera) this.playhead.do({ do: "set", follow: true });
      rig.go(message.camera ?? USUAL, shown, message.gently);
    } else {
      if (message.move && is.follow) { this.playhead.do({ do: "set", follow: false }); rig.follow(false); }
      rig.orbit(message, shown);
    }
    this.show(true);
    this.wake(true);
    this.tell("camera", message);
    return true;
  }

  // Has the camera follow some modules instead of the whole chain, from where `sight` says that they are
  // seen best; none for all again.
  /**
   * @param {number[]} modules
   * @param {import("./camera_rig.js").Sight | null} sight
   */
  lookAt(modules, sight = null) {
    if (!modules.length && !this.rig.group) return;
    if (modules.length && !this.is.follow) this.playhead.do({ do: "set", follow: true });
    this.rig.lookAt(modules, sight);
    this.show(true);
  }

  /**
   * @param {Vector} origin
   * @param {Vector} direction
   */
  pick(origin, direction) {
    if (!this.shown) return;
    const module = picked(this.timeline.chain, this.shown, origin, direction);
    if (module === null && this.selected === null) return;
    this.send({ do: "select", module: module === this.selected ? null : module });
  }

  // Another way to colour the modules; see colours.js.
  /** @param {import("./colours.js").Colouring} chosen */
  colourBy(chosen) {
    this.colouring = chosen;
    this.tell("colouring", chosen);
    this.show(true);
  }

  // What time does.

  begin() {
    const { timeline, playhead } = this;
    this.shown = null;
    this.search = null;
    this.colourBy(colouring(this.colouring?.key ?? "error", timeline, this.colouring?.figures));
    this.rig.begin();
    this.selected = this.selected !== null && this.selected < timeline.chain.modules ? this.selected : null;
    this.stage?.set(timeline.bundle);
    this.sketch?.set(timeline.bundle);
    if (timeline.growing && this.is.live) playhead.frame = timeline.last;
    else this.story.begun();
    playhead.frame = Math.min(playhead.frame, timeline.last);
    this.tell("begun");
    this.show(true);
    this.tellOutline();
    for (const message of this.unheard.splice(0)) this.send(message);
  }

  grew() {
    if (!this.timeline.chain) return;
    this.rig.goals.clear();
    this.tellOutline();
    this.show(true);
  }

  tellOutline() {
    const { timeline } = this;
    const { modules, rigid_links: rigid } = timeline.chain;
    this.tell("outline", { ...timeline.outline, frames: timeline.total, growing: timeline.growing, modules, joints: modules - 1 - rigid });
  }

  get busy() {
    const { is } = this;
    return this.changed || this.gliding || this.timeline.standing.fading || is.playing || is.live || is.turn;
  }

  // Ask for one more tick: after the pause, or with the next picture for a visitor who moves the view.
  wake(soon = false) {
    if (this.due && !(soon && this.pause)) return;
    clearTimeout(this.pause);
    this.pause = undefined;
    this.due = true;
    const paint = () => {
      this.pause = undefined;
      requestAnimationFrame((now) => { this.due = false; this.tickedMs = performance.now(); this.tick(now / 1000); });
    };
    const left = soon ? 0 : this.pauseMs() - (performance.now() - this.tickedMs);
    if (left > 0) this.pause = setTimeout(paint, left); else paint();
  }

  /** @param {number} now */
  tick(now) {
    const passed = this.clock === null ? 0 : Math.min(Math.max(now - this.clock, 0), LONGEST_TICK_S);
    if (!this.timeline.chain || !this.shown) { this.clock = null; return; }
    if (this.timeline.standing.advance(passed)) { this.rig.goals.clear(); this.show(true); }
    this.story.advance(passed);
    if (this.playhead.advance(passed, now)) this.show();
    const drawn = this.changed;
    this.changed = false;
    let moved = this.stage?.bundle ? this.stage.moveGround(passed, this.shown) : false;
    moved = this.rig.glide(passed, this.shown) || moved;
    this.gliding = moved;
    if (drawn || moved) this.draw();
    this.clock = this.busy ? now : null;
    if (this.busy) this.wake();
  }

  // Takes the snapshot that the playhead is at.
  show(again = false) {
    const { timeline, playhead } = this;
    if (!timeline.chain || !this.colouring) return;
    const frame = playhead.shown;
    const moved = !this.shown || this.shown.frame !== frame || !this.shown.exact;
    if (moved || again) {
      const shown = timeline.snapshot(frame);
      if (!shown) return;
      this.shown = shown;
      this.rig.turnToGroup(shown);
      this.aim();
      this.changed = true;
      if (this.selected !== null && moved) this.tellModule();
    }
    if (this.shown) this.tellState(this.shown);
    this.wake();
  }

  // While a drawing stands in, as often as one can read: every word has to be put into the picture.
  /** @param {Snapshot} shown */
  tellState(shown) {
    const { timeline, is, playhead } = this;
    const now = performance.now();
    if (this.standIn?.latest && is.playing && this.lastPlaying && now - this.toldAt < TELL_MS && playhead.frame < timeline.last) return;
    Object.assign(this, { toldAt: now, lastPlaying: is.playing });
    let error = -1;
    for (const e of shown.errors) if (Math.abs(e) > error) error = Math.abs(e);
    const state = {
      ...is, frame: playhead.frame, frames: timeline.total, growing: timeline.growing, time_s: shown.time_s, phase: shown.phase, error_rad: error < 0 ? null : error,
      folded: Math.round(1000 * timeline.folded(shown)) / 1000, pace: this.paceAt(shown),
    };
    const text = JSON.stringify(state);
    if (text === this.told) return;
    this.told = text;
    this.tell("state", state);
  }

  // Seconds of the robot that pass in one second of playing; null where no robot moves.
  /** @param {Snapshot} shown */
  paceAt({ low, phase, exact }) {
    const { timeline, playhead, is } = this;
    if (phase === "explosion" || !exact || this.story.telling) return null;
    if (is.real) return 1;
    const first = Math.min(low, Math.max(0, timeline.last - 1));
    const [a, b] = [timeline.row(first), timeline.row(first + 1)];
    return a && b && a.phase === b.phase && b.time_s > a.time_s ? (b.time_s - a.time_s) * playhead.framesPerSecond * is.speed : null;
  }

  tellModule() {
    const { timeline, shown, selected: index } = this;
    if (index === null || !shown) { this.tell("module", { index: null }); return; }
    const { chain } = timeline;
    const first = (index - chain.rigid_links) * chain.hinges;
    const columns = first >= 0 && first < timeline.joints ? Array.from({ length: chain.hinges }, (_, k) => first + k) : [];
    const at = timeline.foldedPositions;
    this.tell("module", {
      index,
      modules: chain.modules,
      cell: chain.cells ? [0, 1, 2].map((k) => Math.round(at[3 * index + k])) : null,
      joints: columns.map((j) => ({
        name: nameOf(chain, j), column: j, angle_rad: shown.angle(j), target_rad: timeline.foldedRad[j],
        error_rad: Number.isNaN(shown.errors[j]) ? null : Math.abs(shown.errors[j]),
      })),
      shown,
    });
  }

  colours() {
    if (!this.colouring || !this.shown) return new Uint8Array(0);
    const colours = this.colouring.of(this.shown);
    const { selected } = this;
    const { selected: blue, stuck } = this.timeline.bundle.header.colours;
    for (const module of this.marked) colours.set(stuck, 3 * module);
    if (selected === null) return colours;
    for (const beside of [selected - 1, selected + 1]) {
      if (beside < 0 || beside >= this.timeline.chain.modules) continue;
      for (let c = 0; c < 3; c++) colours[3 * beside + c] += (blue[c] - colours[3 * beside + c]) * BESIDE;
    }
    colours.set(blue, 3 * selected);
    return colours;
  }

  draw() {
    const { shown, rig: { eye } } = this;
    if (!shown || !eye) return;
    const colours = this.colours();
    if (this.standIn) this.standIn.draw(shown, colours, eye);
    else this.sketch?.draw(shown, colours, eye, null);
    this.tell("drawn", shown.frame);
  }

  aim() {
    if (!this.shown) return;
    this.rig.aim(this.shown);
    this.gliding = true;
    this.wake();
  }
}
