// Plays the stops of a tour: moves to a stop, shows its caption once its picture is there, waits
// until the caption is read, and continues.
import { cameraIn } from "../player/address.js";
import { USUAL } from "../player/camera_rig.js";
import { USUAL_COLOURING } from "../player/colours.js";
import { positionOf } from "../viewer/camera.js";
import { clearestSight } from "../viewer/viewpoint.js";
import { frameBetween, movingSeconds, readingSeconds } from "./state.js";

const STILL = 1e-6; // tolerance in frames
const SLACK = 0.5; // frames; a larger deviation means that the visitor has moved the playhead
const HOLD_MS = 4000; // for which a stop stands still before its part plays

export class Flight {
  // With reduced motion (`calm`), a stop is shown without an animation.
  /**
   * @param {import("../player/player.js").Player} player
   * @param {{ calm: boolean, page: Addressed, arrived: () => void, over: () => void,
   *   interrupted: () => void }} around
   *   `arrived` is called when the picture of a stop is there, `over` after the reading time of its
   *   caption, `interrupted` when the visitor moves the playhead
   */
  constructor(player, { calm, page, arrived, over, interrupted }) {
    this.player = player;
    this.calm = calm;
    this.page = page;
    this.arrived = arrived;
    this.over = over;
    this.interrupted = interrupted;
    /**
     * @type {{ from: number, to: number, begun: number, seconds: number, frame: number,
     *   isTurning: boolean } | null}
     */
    this.way = null;
    /** @type {TourStop | null} */
    this.stop = null;
    this.playing = false;
    this.moving = false; // true until the picture of the stop is there
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.reading = undefined;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.holding = undefined;
  }

  // Move to a stop or, with `jump`, show it at once. With `view` false, only mark its modules,
  // because the address names a view.
  /**
   * @param {TourStop} stop
   * @param {{ playing?: boolean, view?: boolean, jump?: boolean }} how
   */
  show(stop, { playing = false, view = true, jump = false } = {}) {
    const { player } = this;
    const isSame = this.stop === stop;
    this.end();
    this.stop = stop;
    this.playing = playing;
    player.mark(
      (stop.modules ?? []).map((module) => module - 1),
      "selected",
    );
    if (!view) return;
    this.page.colour(stop.colour ?? USUAL_COLOURING);
    this.page.path(stop.path ?? false);
    player.send({
      do: "set",
      from: null,
      to: null,
      loop: false,
      reverse: false,
      follow: stop.follow ?? true,
    });
    const [from, to] = [player.playhead.frame, stop.frame - 1];
    // The part that this stop repeats is on: it continues.
    if (isSame && player.is.playing && stop.from && from >= stop.from - 1) {
      this.repeat(stop);
      this.read(stop);
      return;
    }
    this.moving = true;
    if (this.calm || jump || Math.abs(to - from) < STILL) {
      this.arrive({ gently: !this.calm && !jump });
      return;
    }
    const isTurning = this.turn(stop, true);
    this.way = {
      from,
      to,
      begun: performance.now(),
      seconds: movingSeconds(to - from),
      frame: from,
      isTurning,
    };
    player.send({ do: "seek", frame: from });
    this.step();
  }

  // Turn the camera to a stop: by default, the whole chain is in view, from the side on which the
  // fewest modules hide those of the stop. Return false while the frame of the stop is not loaded.
  /**
   * @param {TourStop} stop
   * @param {boolean} gently
   */
  turn({ camera, modules, frame }, gently) {
    const { timeline, rig } = this.player;
    const moment = timeline.peek(frame - 1);
    if (!moment?.exact) return false;
    let direction = cameraIn(camera ?? null);
    if (!direction && modules) {
      const { elevation_rad: rise } = timeline.bundle.header.camera;
      const viewFrom = (/** @type {number | null} */ azimuth, /** @type {number} */ elevation) =>
        rig.whole(moment, { azimuth, elevation });
      const [azimuth, elevation] = clearestSight(
        moment.positions,
        modules.map((module) => module - 1),
        [viewFrom(null, rise).azimuth, rise],
        (turn, height) => {
          const [x, y, z] = positionOf(viewFrom(turn, height));
          return [x / rig.pitch, y / rig.pitch, z / rig.pitch];
        },
      );
      direction = { ...USUAL, azimuth, elevation };
    }
    this.player.send({ do: "camera", camera: direction, gently });
    return true;
  }

  step() {
    const { way, player } = this;
    if (!way) return;
    if (player.is.playing || Math.abs(player.playhead.frame - way.frame) > SLACK) {
      this.interrupted();
      return;
    }
    const share = (performance.now() - way.begun) / 1000 / way.seconds;
    if (share >= 1) {
      this.arrive({ gently: true, isTurned: way.isTurning });
      return;
    }
    way.frame = frameBetween(way.from, way.to, share);
    player.send({ do: "seek", frame: way.frame });
    way.frame = player.playhead.frame;
    requestAnimationFrame(() => {
      if (this.way === way) this.step();
    });
  }

  /** @param {{ gently: boolean, isTurned?: boolean }} how */
  arrive(how) {
    this.way = null;
    if (!this.stop) return;
    this.player.send({ do: "seek", frame: this.stop.frame - 1 });
    this.wait(this.stop, how);
  }

  // Wait until the frame of the stop is loaded and drawn, and the camera is there.
  /**
   * @param {TourStop} stop
   * @param {{ gently: boolean, isTurned?: boolean }} how
   */
  wait(stop, { gently, isTurned = false }) {
    const { player } = this;
    if (this.isElsewhere(stop)) {
      this.interrupted();
      return;
    }
    const turned = isTurned || this.turn(stop, gently);
    const glides = gently && player.gliding && !player.is.turn;
    if (!turned || !player.snapshot?.exact || player.changed || glides) {
      requestAnimationFrame(() => {
        if (this.moving && this.stop === stop) this.wait(stop, { gently, isTurned: turned });
      });
      return;
    }
    this.moving = false;
    this.arrived();
    if (stop.from && !this.calm)
      this.holding = setTimeout(() => {
        if (!this.isElsewhere(stop)) this.repeat(stop);
      }, HOLD_MS);
    this.read(stop);
  }

  // Return true if the visitor has moved the playhead away from a stop.
  /** @param {TourStop} stop */
  isElsewhere({ frame }) {
    const { is, playhead } = this.player;
    return is.playing || Math.abs(playhead.frame - (frame - 1)) > SLACK;
  }

  // Play the part that a stop repeats, if there is one.
  /** @param {TourStop} stop */
  repeat({ from, to }) {
    if (!from || !to) return;
    this.player.send({ do: "set", from: from - 1, to: to - 1, loop: true });
    this.player.send({ do: "play" });
  }

  // Continue with the next stop when the caption is read.
  /** @param {TourStop} stop */
  read({ caption }) {
    if (this.playing) this.reading = setTimeout(() => this.over(), 1000 * readingSeconds(caption));
  }

  // Go no further than to the current stop.
  pause() {
    clearTimeout(this.reading);
    this.playing = false;
  }

  // Stop at the current frame.
  end() {
    this.pause();
    clearTimeout(this.holding);
    this.way = null;
    this.moving = false;
  }

  // Restore the view without a tour.
  close() {
    this.end();
    this.stop = null;
    this.player.mark([]);
  }
}
