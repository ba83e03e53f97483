// Plays the stops of a tour: moves to a stop, waits until its caption is read, and continues.
import { cameraIn } from "../player/address.js";
import { USUAL_COLOURING } from "../player/colours.js";
import { clearestSight } from "../viewer/viewpoint.js";
import { frameBetween, movingSeconds, readingSeconds } from "./state.js";

const STILL = 1e-6; // tolerance in frames
const SLACK = 0.5; // frames; a larger deviation means that the visitor has moved the playhead

export class Flight {
  // With reduced motion (`calm`), a stop is shown without an animation.
  /**
   * @param {import("../player/player.js").Player} player
   * @param {{ calm: boolean, page: Addressed, over: () => void, interrupted: () => void }} around
   *   `over` is called after the reading time of a caption, `interrupted` when the visitor moves
   *   the playhead
   */
  constructor(player, { calm, page, over, interrupted }) {
    this.player = player;
    this.calm = calm;
    this.page = page;
    this.over = over;
    this.interrupted = interrupted;
    /**
     * @type {{ from: number, to: number, begun: number, seconds: number, frame: number } | null}
     */
    this.way = null;
    /** @type {TourStop | null} */
    this.stop = null;
    this.playing = false;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.reading = undefined;
  }

  // Move to a stop. With `view` false, only mark its modules, because the address names a view.
  /**
   * @param {TourStop} stop
   * @param {{ playing?: boolean, view?: boolean }} how
   */
  show(stop, { playing = false, view = true } = {}) {
    const { player, calm } = this;
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
    const camera = cameraIn(stop.camera ?? null);
    if (!camera && stop.modules)
      player.lookAt(
        stop.modules.map((module) => module - 1),
        clearestSight,
      );
    else player.send({ do: "camera", camera, gently: !calm });
    const [from, to] = [player.playhead.frame, stop.frame - 1];
    // The part that a stop repeats is on: it continues.
    if (
      !calm &&
      player.is.playing &&
      stop.from &&
      stop.to &&
      from >= stop.from - 1 &&
      from < stop.to
    ) {
      this.repeat(stop);
      this.read(stop);
      return;
    }
    if (calm || Math.abs(to - from) < STILL) {
      this.arrive();
      return;
    }
    this.way = {
      from,
      to,
      begun: performance.now(),
      seconds: movingSeconds(to - from),
      frame: from,
    };
    player.send({ do: "seek", frame: from });
    this.step();
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
      this.arrive();
      return;
    }
    way.frame = frameBetween(way.from, way.to, share);
    player.send({ do: "seek", frame: way.frame });
    way.frame = player.playhead.frame;
    requestAnimationFrame(() => {
      if (this.way === way) this.step();
    });
  }

  arrive() {
    const { player, stop } = this;
    this.way = null;
    if (!stop) return;
    player.send({ do: "seek", frame: stop.frame - 1 });
    if (!this.calm) this.repeat(stop);
    this.read(stop);
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

  // Stop at the current frame.
  end() {
    clearTimeout(this.reading);
    this.way = null;
    this.playing = false;
  }

  // Restore the view without a tour.
  close() {
    this.end();
    this.stop = null;
    this.player.mark([]);
  }
}
