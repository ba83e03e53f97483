// Pictures of a film: the fold as the visitor sees it, drawn at the size of the film.
import { CameraRig } from "../player/camera_rig.js";
import { groundAfter } from "../viewer/stage.js";
import { floorUnder } from "../viewer/sketch.js";
import { captionText, titleText } from "./labels.js";
import { FPS, paceOf, schedule } from "./schedule.js";

const LOOK_MS = 100; // between two looks for data that is still loading
// Speed at which the camera turns around the finished shape; it shows words more from their front.
const END_TURN_RAD_S = -0.09;
const CAPTION_ROOM = 0.16; // fraction of the picture's height that stays free for captions
/** @type {Record<"light" | "dark", [inside: string, outside: string]>} */
const GROUNDS = {
  light: ["rgb(252 251 249)", "rgb(233 230 223)"],
  dark: ["rgb(38 42 48)", "rgb(20 22 26)"],
};

/**
 * @typedef {object} FilmOptions
 * @property {number} width
 * @property {number} height
 * @property {number} seconds
 * @property {boolean} whole whether the film begins with the unfolding
 * @property {string} title
 * @property {TourStop[]} stops of the tour; none without captions
 */

export class Pictures {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {FilmOptions} options
   * @param {AbortSignal | null} signal ends waits for data
   */
  constructor(player, options, signal = null) {
    const { timeline } = player;
    this.player = player;
    this.colouring = player.colouring;
    this.options = options;
    this.signal = signal;
    const folding = timeline.outline.phases.findLast(({ name }) => name === "playback");
    const first = options.whole || !folding ? 0 : folding.from;
    const pace = paceOf(timeline, first, timeline.last);
    this.schedule = schedule({ ...options, pace });
    this.dark = themeNow() === "dark";
    this.rig = this.camera((timeline.last - first) / options.seconds);
    /** @type {number | null} */
    this.ground = null;
    /** @type {Map<string, Label>} */
    this.captions = new Map();
    /** @type {Label | null} */
    this.title = null;
    /** @type {ImageBitmap[]} */
    this.images = []; // of texts, until the first picture is drawn
  }

  get count() {
    return this.schedule.frames.length;
  }

  // Return a camera that starts like that of the page and follows the film.
  /** @param {number} framesPerSecond */
  camera(framesPerSecond) {
    const {
      player: { rig: seen, timeline, is },
      options: { width, height, stops },
    } = this;
    const aspect = width / height;
    const rig = new CameraRig(
      timeline,
      { is: { ...is, playing: true, live: false }, framesPerSecond },
      { aspect: () => aspect, calm: false },
    );
    if (is.follow) {
      // Stops of a tour and places in a plan show a few modules; a film shows the whole chain.
      if (!seen.group) rig.choose(seen.choice);
      if (stops.length) rig.cover(CAPTION_ROOM);
    } else if (seen.view) {
      // A narrower picture shows the same width.
      const farther = Math.max(1, seen.aspect / aspect);
      rig.view = rig.goal = { ...seen.view, distance: seen.view.distance * farther };
    }
    return rig;
  }

  // Draw the texts once.
  async prepare() {
    const { width, height, title, stops } = this.options;
    const { fontFamily: family } = getComputedStyle(document.body);
    const look = { width, height, dark: this.dark, family };
    const { images } = this;
    const added = (/** @type {import("./labels.js").Text} */ { image, y }) => ({
      image: images.push(image) - 1,
      y,
    });
    if (title.trim()) this.title = added(await titleText(title, look));
    for (const { caption } of stops)
      this.captions.set(caption, added(await captionText(caption, look)));
  }

  // Return picture k; pictures are drawn in order.
  /** @param {number} k */
  async at(k) {
    const { player, rig, schedule: plan } = this;
    const snapshot = await this.moment(plan.frames[k]);
    const stop = plan.stops[k];
    if (rig.is.follow && snapshot.frame === player.timeline.last)
      rig.orbit({ turn: [END_TURN_RAD_S / FPS, 0] }, snapshot);
    rig.aim(snapshot);
    rig.glide(1 / FPS, snapshot);
    if (!rig.eye || !player.sketch) throw new Error("There is no view to film yet.");
    if (this.images.length) player.sketch.setTexts(this.images.splice(0));
    const colours = this.colours(snapshot, stop);
    return player.sketch.filmed([snapshot, colours, rig.eye, this.groundAt(snapshot)], {
      ...this.options,
      ground: this.backdrop,
      labels: this.labels(stop),
    });
  }

  // Return the colours that the page had when the film began, with the modules of a stop.
  /**
   * @param {Snapshot} snapshot
   * @param {TourStop | null} stop
   */
  colours(snapshot, stop) {
    const { selected } = this.player.timeline.bundle.header.colours;
    const colours = this.colouring?.of(snapshot) ?? new Uint8Array(0);
    for (const module of stop?.modules ?? []) colours.set(selected, 3 * (module - 1));
    return colours;
  }

  // Return the moment at a frame, once it and the values of its colours are loaded.
  /** @param {number} frame */
  async moment(frame) {
    const {
      colouring,
      player: { timeline },
    } = this;
    for (;;) {
      const snapshot = timeline.snapshot(frame);
      if (snapshot?.exact && colouring?.isLoaded(snapshot)) return snapshot;
      this.signal?.throwIfAborted();
      await new Promise((done) => setTimeout(done, LOOK_MS));
    }
  }

  /** @param {Snapshot} snapshot */
  groundAt(snapshot) {
    const { stage, timeline } = this.player;
    const { pitch, table } = timeline.bundle.header;
    if (table) return stage?.ground ?? table.height * pitch;
    const low = floorUnder(snapshot) * pitch;
    this.ground = groundAfter(this.ground ?? low, low, 1 / FPS, pitch);
    return this.ground;
  }

  /** @returns {Ground} */
  get backdrop() {
    const [inside, outside] = GROUNDS[this.dark ? "dark" : "light"];
    return (
      this.player.sketch?.painted ?? {
        place: [1, 1, 0.5, 0.4],
        stops: [
          [0, inside],
          [1, outside],
        ],
      }
    );
  }

  // Return the title, which stays for the whole film, and the caption of a stop.
  /** @param {TourStop | null} stop */
  labels(stop) {
    const caption = stop && this.captions.get(stop.caption);
    return [this.title, caption].filter((label) => label != null);
  }
}

function themeNow() {
  const { theme } = document.documentElement.dataset;
  if (theme === "light" || theme === "dark") return theme;
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}
