// Chooses between the 3D view and the page's own drawing on top of it. The drawing is visible until
// the view has started and, if the view is too slow, during every motion.
import { isSoftware } from "./scene.js";

/** @typedef {import("./stage.js").Picture} Picture */
/** @typedef {import("./stage.js").Stage} Stage */

const SLOW_MS = 70; // per picture; up to it the view is fast enough
const MEASURED_PICTURES = 4; // the slowest is ignored, because it may have compiled shaders
const MIN_SLOW_MODULES = 300; // software rendering of so many is always too slow
const REST_MS = 400; // without motion, after which the view takes over

// Times of the view's latest pictures.
export class PictureTimes {
  /** @param {Stage} stage */
  constructor(stage) {
    this.stage = stage;
    /** @type {number[]} */
    this.latestMs = [];
    this.measuring = false;
  }

  get slow() {
    const { latestMs, stage } = this;
    if (latestMs.length < MEASURED_PICTURES)
      return (stage.bundle?.header.chain.modules ?? 0) >= MIN_SLOW_MODULES && isSoftware();
    const sum = latestMs.reduce((a, b) => a + b, 0);
    return (sum - Math.max(...latestMs)) / (MEASURED_PICTURES - 1) > SLOW_MS;
  }

  // Call back once the view has painted what it was sent last. Measure that
  // time, unless a measurement is in progress or the page is hidden.
  /** @param {() => void} then */
  measure(then) {
    const startMs = performance.now();
    const isFirst = !this.measuring;
    this.measuring = true;
    this.stage.ask("pass", () => {
      if (isFirst) {
        this.measuring = false;
        if (!document.hidden)
          this.latestMs = [...this.latestMs, performance.now() - startMs].slice(-MEASURED_PICTURES);
      }
      then();
    });
  }
}

/**
 * What is visible, and what ends it:
 * - `starting`: the drawing, of `picture`, until the view has painted its first picture. `asked`:
 *   the view is open and was asked to report that picture.
 * - `viewing`: the view, until a motion starts for which it is too slow.
 * - `drawing`: the drawing, until nothing has moved for a while.
 * - `yielding`: the drawing, until the view has painted the same picture.
 * @typedef {{ is: "starting", picture: Picture | null, asked: boolean } | { is: "viewing" }
 *   | { is: "drawing" | "yielding", picture: Picture }} StandInState
 */

export class StandIn {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Stage} stage
   * @param {import("./sketch.js").Sketch} sketch
   */
  constructor(canvas, stage, sketch) {
    this.canvas = canvas;
    this.stage = stage;
    this.sketch = sketch;
    this.times = new PictureTimes(stage);
    /** @type {StandInState} */
    this.state = { is: "starting", picture: null, asked: false };
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined; // runs in the state `drawing` only
    this.onOpen = () => {};
    this.painted = () => {};
    this.busy = () => false; // true during automatic motion
    this.held = false; // true while the drawing replaces the view in any case
    sketch.onDrawn = () => {
      if (this.covers) {
        canvas.classList.remove("gone");
        stage.frame.classList.add("behind");
      }
      this.painted();
    };
  }

  // True while the drawing replaces a view that has started.
  get covers() {
    return this.state.is === "drawing" || this.state.is === "yielding";
  }

  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   * @param {Eye} eye
   */
  draw(snapshot, colours, eye) {
    const { state, stage, times } = this;
    /** @type {Picture} */
    const picture = [snapshot, colours, eye];
    stage.eye = eye;
    if (state.is === "starting") this.drawBoth(state, picture);
    else if (times.slow && !stage.through) this.drawSketch(picture);
    else this.drawView(picture);
  }

  // The view needs a first picture; a slow view gets no more of them.
  /**
   * @param {StandInState & { is: "starting" }} state
   * @param {Picture} picture
   */
  drawBoth(state, picture) {
    state.picture = picture;
    if (!state.asked || !this.times.slow) this.stage.draw(...picture);
    this.sketch.draw(...picture, this.stage.ground);
    this.takeOver();
  }

  /** @param {Picture} picture */
  drawSketch(picture) {
    this.enter({ is: "drawing", picture });
    this.stage.rest();
    this.sketch.draw(...picture, this.stage.ground);
  }

  /** @param {Picture} picture */
  drawView(picture) {
    this.canvas.classList.remove("fading");
    this.stage.draw(...picture);
    this.times.measure(this.painted);
    if (this.state.is === "drawing") this.yield(this.state.picture);
  }

  // Let the view take over once its first picture is visible.
  takeOver() {
    const { state, stage } = this;
    if (state.is !== "starting" || state.asked || !state.picture || !stage.open) return;
    state.asked = true;
    stage.painted(() => {
      if (this.state !== state) return;
      this.onOpen();
      if ((this.held || this.times.slow) && state.picture) this.rest(state.picture);
      else this.enter({ is: "viewing" });
    });
  }

  // Show the drawing again until the view has restarted.
  fallBack() {
    this.enter({ is: "starting", picture: this.stage.latest, asked: false });
  }

  // Show a picture of the drawing in the view, once nothing moves.
  /** @param {Picture} picture */
  rest(picture) {
    if (this.held || this.busy()) {
      if (this.held) this.stage.rest();
      this.enter({ is: "drawing", picture });
      return;
    }
    this.stage.draw(...picture);
    this.times.measure(this.painted);
    this.yield(picture);
  }

  // Show the drawing instead of the view, or reverse this: with software rendering, even a view at
  // rest takes more processor time than a film.
  /** @param {boolean} on */
  hold(on) {
    this.held = on;
    if (on && this.state.is === "viewing" && this.stage.latest) this.drawSketch(this.stage.latest);
  }

  // Hide the drawing once the view shows the same
  // picture, unless the drawing is needed again by then.
  /** @param {Picture} picture */
  yield(picture) {
    /** @type {StandInState} */
    const state = { is: "yielding", picture };
    this.enter(state);
    this.stage.painted(() => {
      if (this.state === state) this.enter({ is: "viewing" });
    });
  }

  /** @param {StandInState} state */
  enter(state) {
    const { canvas, stage, busy } = this;
    this.state = state;
    clearTimeout(this.timer);
    if (state.is === "drawing") this.timer = setTimeout(() => this.rest(state.picture), REST_MS);
    if (state.is !== "drawing") stage.frame.classList.remove("behind");
    // A fade during a motion would leave a ghost image.
    canvas.classList.toggle("fading", state.is === "viewing" && !busy());
    canvas.classList.toggle("standing-in", this.covers);
    // In the state `drawing`, the view stays visible until the drawing is ready.
    if (state.is === "viewing") canvas.classList.add("gone");
    if (state.is === "starting") canvas.classList.remove("gone");
  }
}
