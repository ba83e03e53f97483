// Two folds on one playhead. Both go through a phase in step,
// whatever their numbers of frames; a fold without that phase waits.
import { frameFolded } from "./kinematics.js";
import { Ticker } from "./player.js";
import { largestError } from "./player_state.js";
import { Playhead } from "./playhead.js";
import { Emitter } from "./timeline.js";

/** @typedef {import("./player.js").Player} Player */

export class Pair extends Emitter {
  /** @param {Player[]} players */
  constructor(players) {
    super();
    this.players = players;
    /** @type {Phase[]} */
    this.phases = [];
    this.last = 0;
    this.playhead = new Playhead(this);
    this.ticker = new Ticker((passed, now) => {
      if (this.playhead.advance(passed, now)) this.sync();
      else this.wake();
    });
    this.syncing = false;
    this.turning = false; // while a camera is copied to the other players
    this.reportedText = "";
    for (const player of players) {
      player.on("outline", () => this.begin());
      player.on("camera", () => this.turned(player));
      player.on("state", () => this.sync()); // a frame was loaded
      player.on("module", (detail) => this.tell("module", detail));
    }
  }

  get growing() {
    return this.players.some(({ timeline }) => timeline.growing);
  }

  // Remove a fold that has no frames; the other one then plays alone.
  /** @param {Player} player */
  leave(player) {
    this.players = this.players.filter((remaining) => remaining !== player);
    this.begin();
  }

  // Merge the phases of both folds; each is as long as the longer one.
  begin() {
    const outlines = this.players.map(({ timeline }) => timeline.outline);
    if (
      !this.players.length ||
      this.players.some(({ snapshot, timeline }) => !snapshot || !timeline.outline)
    )
      return;
    const first = this.phases.length === 0;
    const { names } = outlines[0];
    const long = (/** @type {string} */ name) =>
      Math.max(
        ...outlines.map(({ phases }) =>
          phases.filter((p) => p.name === name).reduce((sum, p) => sum + p.to - p.from, 0),
        ),
      );
    const order = names
      .filter((name) => long(name) > 0)
      .sort((a, b) => this.place(outlines, a) - this.place(outlines, b));
    let from = 0;
    this.phases = order.map((name) => {
      const phase = { name, from, to: from + long(name) };
      from = phase.to;
      return phase;
    });
    this.last = Math.max(0, from - 1);
    const scale = Math.max(...outlines.map((outline) => outline.error_scale_rad));
    for (const { timeline } of this.players) timeline.sharedScale = scale;
    this.tell("outline", {
      frames: from,
      phases: this.phases,
      errors: this.errors(outlines),
      error_scale_rad: scale,
      growing: this.growing,
    });
    if (first) this.tell("begun");
    this.sync();
  }

  // The part of the view that both folds share.
  get moment() {
    const { is, frame } = this.playhead;
    return {
      frame,
      from: is.loop ? is.from : null,
      to: is.loop ? is.to : null,
      loop: is.loop,
      speed: is.speed,
      play: is.playing,
    };
  }

  // Return the index of a phase in the folds that have it.
  /**
   * @param {TimelineOutline[]} outlines
   * @param {string} name
   */
  place(outlines, name) {
    return Math.min(
      ...outlines
        .map(({ phases }) => phases.findIndex((p) => p.name === name))
        .filter((k) => k >= 0),
    );
  }

  // Return the larger error of the two folds for each column of the plot.
  /** @param {TimelineOutline[]} outlines */
  errors(outlines) {
    return Array.from({ length: 240 }, (_, k) => {
      const frame = (this.last * k) / 240;
      const values = this.players
        .map((player, n) => {
          const { frames, errors } = outlines[n];
          return errors[
            Math.min(
              errors.length - 1,
              Math.floor((this.frameOf(player, frame) / frames) * errors.length),
            )
          ];
        })
        .filter((v) => v !== null && v !== undefined);
      return values.length ? Math.max(...values) : null;
    });
  }

  /**
   * @param {Player} player
   * @param {number} frame
   */
  frameOf({ timeline }, frame) {
    const at = this.phaseAt(frame);
    const { phases } = timeline.outline;
    const phase = phases.find(({ name }) => name === at.name);
    if (phase)
      return (
        phase.from +
        Math.min(1, (frame - at.from) / Math.max(1, at.to - 1 - at.from)) *
          (phase.to - 1 - phase.from)
      );
    const after = phases.find(
      ({ name }) => this.phases.findIndex((p) => p.name === name) > this.phases.indexOf(at),
    );
    return after ? after.from : timeline.last;
  }

  /** @param {number} frame */
  phaseAt(frame) {
    return this.phases.find(({ to }) => frame < to) ?? this.phases[this.phases.length - 1];
  }

  /** @param {Command} message */
  send(message) {
    if (!this.phases.length) return false;
    if (message.do === "orbit" || message.do === "camera") {
      this.players[0].send(message);
      return true;
    }
    if (message.do === "select") {
      for (const player of this.players) player.send(message);
      return true;
    }
    if (
      !this.playhead.do(
        message.do === "fold"
          ? { do: "seek", frame: this.frameFolded(message.percent / 100) }
          : message,
      )
    )
      return false;
    if (message.do === "set") {
      const { follow, turn } = message; // the part that concerns the camera
      for (const player of this.players)
        player.send({
          do: "set",
          ...("follow" in message && { follow }),
          ...("turn" in message && { turn }),
        });
    }
    this.sync();
    return true;
  }

  // Give the other players the same camera, relative to their own chains.
  /** @param {Player} player */
  turned(player) {
    if (this.turning) return;
    this.turning = true;
    const { follow } = player.is;
    if (this.playhead.is.follow !== follow) this.send({ do: "set", follow });
    for (const follower of this.players)
      if (follower !== player)
        follower.send({ do: "camera", camera: player.rig.at(player.snapshot) });
    this.turning = false;
    this.tell("camera");
  }

  // Return the frame at which the first fold has this progress of folding.
  /** @param {number} share */
  frameFolded(share) {
    const [first] = this.players;
    const frame = frameFolded(first.timeline, share);
    return frame === null ? this.playhead.frame : this.frameAt(first, frame);
  }

  // Return the pair's frame for a frame of one fold.
  /**
   * @param {Player} player
   * @param {number} frame
   */
  frameAt({ timeline }, frame) {
    const phase = timeline.outline.phases.find(({ to }) => frame < to);
    const at = this.phases.find(({ name }) => name === phase?.name);
    if (!phase || !at) return this.playhead.frame;
    return (
      at.from +
      ((frame - phase.from) / Math.max(1, phase.to - 1 - phase.from)) * (at.to - 1 - at.from)
    );
  }

  sync() {
    if (this.syncing || !this.phases.length) return;
    this.syncing = true;
    const { frame } = this.playhead;
    for (const player of this.players)
      player.send({ do: "seek", frame: this.frameOf(player, frame) });
    this.syncing = false;
    const at = this.phaseAt(frame);
    const errors = this.players
      .map(({ snapshot }) => snapshot && largestError(snapshot))
      .filter((error) => error !== null);
    const [{ snapshot: first, timeline }] = this.players;
    const state = {
      ...this.playhead.is,
      frame: this.playhead.frame,
      frames: this.last + 1,
      growing: this.growing,
      phase: at.name,
      time_s: null,
      error_rad: errors.length ? Math.max(...errors) : null,
      folded: first && timeline.folded(first),
      pace: null,
    };
    const text = JSON.stringify(state);
    if (text !== this.reportedText) {
      this.reportedText = text;
      this.tell("state", state);
    }
    this.wake();
  }

  wake() {
    const { playing, live } = this.playhead.is;
    if (playing || live) this.ticker.wake();
    else this.ticker.rest();
  }
}
