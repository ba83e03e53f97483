// A player: shows the moment at the playhead, advances it, and moves the camera.
//
// Besides the messages of playhead.js it accepts: select {module} highlights a module (null: none);
// pass {seconds} seeks a frame by its time; change {way} seeks the next visible change; orbit
// turns, zooms and moves the view; camera {camera} sets it (null: the default). Its events are
// waiting, begun, outline, state, module, camera, drawn and painted.
import { picked } from "../viewer/camera.js";
import { Sketch } from "../viewer/sketch.js";
import { CameraRig, USUAL } from "./camera_rig.js";
import { USUAL_COLOURING, colouringFor, usualColouring } from "./colours.js";
import { heldStill } from "./kinematics.js";
import { PlayerState } from "./player_state.js";
import { Recording, Timeline } from "./timeline.js";

const MAX_TICK_S = 0.2;
const TELL_MS = 200;
const USUAL_ASPECT = 1.6;

/** @typedef {import("../viewer/stage.js").Stage} Stage */

// Calls `tick` with the animation frames of the page, once per request.
export class Ticker {
  due = false;
  tickedMs = 0; // time of the last tick
  /** @type {number | null} time of the previous tick, in seconds; null after a rest */
  clock = null;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  pause = undefined; // timer of the pause before the next tick

  /**
   * @param {(passed: number, now: number) => void} tick in seconds
   * @param {() => number} pauseMs minimum time between two ticks
   */
  constructor(tick, pauseMs = () => 0) {
    this.tick = tick;
    this.pauseMs = pauseMs;
  }

  // Request one more tick: after the pause or, with `soon`, with
  // the next animation frame, for a visitor who moves the view.
  wake(soon = false) {
    if (this.due && !(soon && this.pause)) return;
    clearTimeout(this.pause);
    this.pause = undefined;
    this.due = true;
    const waitMs = soon ? 0 : this.pauseMs() - (performance.now() - this.tickedMs);
    if (waitMs > 0) this.pause = setTimeout(() => this.paint(), waitMs);
    else this.paint();
  }

  paint() {
    this.pause = undefined;
    requestAnimationFrame((ms) => {
      const now = ms / 1000;
      const passed = this.clock === null ? 0 : Math.min(Math.max(now - this.clock, 0), MAX_TICK_S);
      this.due = false;
      this.tickedMs = performance.now();
      this.clock = now;
      this.tick(passed, now);
    });
  }

  // Stop the clock while nothing moves: the time until the next tick does not count.
  rest() {
    this.clock = null;
  }
}

export class Player extends PlayerState {
  // Shows the fold on `stage`, for which `standIn` draws at first, or on the sketch alone. With
  // reduced motion (`calm`), the camera jumps to the goal of a frame that was sought.
  /**
   * @param {Timeline} timeline
   * @param {{ usual?: string, stage?: Stage | null,
   *   standIn?: import("../viewer/stand_in.js").StandIn | null, sketch?: Sketch | null,
   *   aspect?: () => number, calm?: boolean, pauseMs?: () => number }} shownOn
   *   `usual` is the first colouring; `pauseMs` returns the minimum time between two pictures of an
   *   automatic motion
   */
  constructor(
    timeline,
    {
      usual = USUAL_COLOURING,
      stage = null,
      standIn = null,
      sketch = null,
      aspect = () => USUAL_ASPECT,
      calm = false,
      pauseMs,
    },
  ) {
    super(timeline, calm);
    this.usual = usual;
    this.stage = stage;
    this.sketch = sketch;
    this.standIn = standIn;
    if (standIn) {
      standIn.busy = () => this.busy;
      standIn.painted = () => this.tell("painted", this.snapshot?.frame);
    }
    this.rig = new CameraRig(timeline, this.playhead, { aspect, calm });
    this.ticker = new Ticker((passed, now) => this.tick(passed, now), pauseMs);
    this.reported = { text: "", atMs: 0, playing: false }; // the last state
    this.gliding = false;
    this.changed = false;
    /** @type {Command[]} */
    this.unheard = []; // messages that wait until a restarted timeline is loaded
    timeline.on("waiting", () => {
      this.snapshot = null;
      this.tell("waiting");
    });
    timeline.on("begun", () => this.begin());
    timeline.on("grew", () => this.grew());
    timeline.on("settled", () => {
      this.story.settled();
      this.show();
    });
    timeline.on("loaded", () => {
      if (this.searchOn()) this.show();
      if (this.snapshot && (!this.snapshot.exact || this.rig.approximate)) this.show(true);
    });
    if (timeline.chain) queueMicrotask(() => this.begin());
  }

  get is() {
    return this.playhead.is;
  }

  // Messages.

  /**
   * @param {Command} command
   * @returns {boolean}
   */
  send(command) {
    if (!this.colouring) return false;
    this.story.heard(command);
    this.tell("asked", command);
    if (!this.timeline.chain) {
      this.unheard.push(command);
      return true;
    }
    const message = this.sought(command);
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

  /** @param {number | null} module */
  select(module) {
    if (!this.setSelected(module)) return;
    this.show(true);
    this.tell("module", this.module);
  }

  // Highlight modules persistently, in the colour of stalled or of selected ones.
  /**
   * @param {number[]} modules
   * @param {"stuck" | "selected"} as
   */
  mark(modules, as = "stuck") {
    this.markedAs = as;
    this.marked = modules.filter((module) => module < this.timeline.chain.modules);
    this.show(true);
  }

  // Colour the part that turns in a step, calm all others and hold them still; null reverses this.
  /** @param {TurningPart | null} step */
  turnPart(step) {
    this.turning = step;
    this.show(true);
  }

  // Turn, zoom, move or set the view. Moving it switches Follow off.
  /** @param {Command & { do: "orbit" | "camera" }} message */
  look(message) {
    const { rig, snapshot, is } = this;
    if (message.do === "camera") {
      if (!message.camera) this.playhead.do({ do: "set", follow: true });
      rig.go(message.camera ?? USUAL, snapshot, message.gently);
    } else {
      if (message.move && is.follow) {
        this.playhead.do({ do: "set", follow: false });
        rig.follow(false);
      }
      rig.orbit(message, snapshot);
    }
    this.show(true);
    this.ticker.wake(true);
    this.tell("camera", message);
    return true;
  }

  // Make the camera follow some modules, from the direction that
  // `sight` finds best; an empty list restores the whole chain.
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
   * @param {number} covered fraction of the picture's height that a panel covers, from below
   * @param {number} above the same from above
   */
  cover(covered, above = 0) {
    if (this.rig.cover(covered, above)) this.show(true);
  }

  /**
   * @param {Vector} origin
   * @param {Vector} direction
   */
  pick(origin, direction) {
    if (!this.snapshot) return;
    const module = picked(this.timeline.chain, this.snapshot, origin, direction);
    if (module === null && this.selected === null) return;
    this.send({ do: "select", module: module === this.selected ? null : module });
  }

  // The colouring that the modules have before anybody chooses one.
  get usualColour() {
    const header = this.timeline.bundle?.header;
    return header ? usualColouring(this.usual, header) : this.usual;
  }

  // Set the colouring of the modules; see colours.js.
  /** @param {import("./colours.js").Colouring} colouring */
  colourBy(colouring) {
    this.colouring = colouring;
    this.tell("colouring", colouring);
    this.show(true);
  }

  // Time.

  begin() {
    const { timeline } = this;
    this.snapshot = this.search = null;
    this.colourBy(
      colouringFor(this.colouring?.key ?? this.usualColour, timeline, this.colouring?.figures),
    );
    this.rig.begin();
    this.stage?.set(timeline.bundle);
    this.sketch?.set(timeline.bundle);
    super.begin();
    this.tell("begun");
    this.show(true);
    this.tell("outline", this.outline);
    for (const message of this.unheard.splice(0)) this.send(message);
  }

  grew() {
    if (!this.timeline.chain) return;
    this.rig.goals.clear();
    this.tell("outline", this.outline);
    this.show(true);
  }

  get busy() {
    const { is } = this;
    return (
      this.changed ||
      this.gliding ||
      this.timeline.standing.fading ||
      is.playing ||
      is.live ||
      is.turn
    );
  }

  /**
   * @param {number} passed
   * @param {number} now
   */
  tick(passed, now) {
    if (!this.timeline.chain || !this.snapshot) {
      this.ticker.rest();
      return;
    }
    if (this.timeline.standing.advance(passed)) {
      this.rig.goals.clear();
      this.show(true);
    }
    const { telling } = this.story;
    this.story.advance(passed);
    const ended = telling && !this.story.telling;
    if (this.playhead.advance(passed, now) || ended) this.show();
    const drawn = this.changed;
    this.changed = false;
    const sank = this.stage?.bundle ? this.stage.moveGround(passed, this.snapshot) : false;
    this.gliding = this.rig.glide(passed, this.snapshot) || sank;
    if (drawn || this.gliding) this.draw();
    if (this.busy) this.ticker.wake();
    else this.ticker.rest();
  }

  // Show the snapshot at the playhead.
  show(redraw = false) {
    const { timeline } = this;
    if (!timeline.chain || !this.colouring) return;
    const { frame } = this.playhead;
    const moved = !this.snapshot || this.snapshot.frame !== frame || !this.snapshot.exact;
    if (moved || redraw) {
      const snapshot = timeline.snapshot(frame);
      if (!snapshot) return;
      this.snapshot = heldStill(snapshot, this.turning?.held);
      this.rig.turnToGroup(this.snapshot);
      this.aim();
      this.changed = true;
      if (this.selected !== null && moved) this.tell("module", this.module);
    }
    if (this.snapshot) this.tellState(this.snapshot);
    this.ticker.wake();
  }

  // Report the state. While the fallback renderer draws, report it at a readable rate only: every
  // change of text makes the page paint again.
  /** @param {Snapshot} snapshot */
  tellState(snapshot) {
    const {
      reported,
      playhead: {
        frame,
        is: { playing },
      },
    } = this;
    const now = performance.now();
    if (
      this.standIn?.covers &&
      playing &&
      reported.playing &&
      now - reported.atMs < TELL_MS &&
      frame < this.timeline.last
    )
      return;
    const state = this.report(snapshot);
    const text = JSON.stringify(state);
    this.reported = { text, atMs: now, playing };
    if (text !== reported.text) this.tell("state", state);
  }

  draw() {
    const {
      snapshot,
      rig: { eye },
    } = this;
    if (!snapshot || !eye) return;
    const colours = this.colours();
    if (this.standIn) this.standIn.draw(snapshot, colours, eye);
    else this.sketch?.draw(snapshot, colours, eye, null);
    this.tell("drawn", snapshot.frame);
  }

  aim() {
    if (!this.snapshot) return;
    this.rig.aim(this.snapshot);
    this.gliding = true;
    this.ticker.wake();
  }
}

// Return a player of the timeline whose address an element
// names, on a canvas in that element, without the 3D view.
/**
 * @param {HTMLElement} part
 * @param {HTMLCanvasElement} canvas
 * @param {string} usual colouring; by default that of the pictures of the paper's experiments
 */
export function playerIn(part, canvas, usual = "error") {
  const player = new Player(new Timeline(new Recording(part.dataset.timeline ?? "")), {
    usual,
    sketch: new Sketch(canvas, () => part.classList.add("moving")),
    aspect: () => canvas.clientWidth / Math.max(1, canvas.clientHeight),
  });
  new ResizeObserver(() => player.show(true)).observe(canvas);
  return player;
}
