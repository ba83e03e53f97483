// Who shows a fold: the 3D view, or the page's own drawing on top of it: until the view has started,
// and, where 3D graphics are software and take long for a picture, for as long as anything moves.
import { isSoftware } from "./scene.js";

const SLOW_MS = 70; // for a picture; below it the view keeps up
const MEASURED = 4; // pictures, of which the slowest does not count: it may have compiled shaders
const MANY = 300; // modules, which software never shows in time
const REST_MS = 400;
const MAX_TAP_PX = 8; // that a pointer moves while it taps

/** @typedef {[Snapshot, Uint8Array, Eye]} Picture */

export class StandIn {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./stage.js").Stage} stage
   * @param {import("./sketch.js").Sketch} sketch
   */
  constructor(canvas, stage, sketch) {
    this.canvas = canvas;
    this.stage = stage;
    this.sketch = sketch;
    this.opened = false; // the view has taken over
    this.begun = false; // it has been given a picture
    /** @type {Picture | null} */
    this.given = null; // the latest one before it took over
    this.asked = false; // whether the first picture can be seen
    this.onOpen = () => {};
    /** @type {number[]} */
    this.times = [];
    this.measuring = false;
    /** @type {Picture | null} */
    this.latest = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.painted = () => {};
    this.busy = () => false; // whether more is to come by itself
    // Until the view has started, the drawing hears of taps itself: see `.sketch` in fold.css.
    let [fromX, fromY] = [0, 0];
    canvas.addEventListener("pointerdown", ({ clientX, clientY }) => { [fromX, fromY] = [clientX, clientY]; });
    canvas.addEventListener("click", ({ offsetX, offsetY, clientX, clientY }) => {
      if (Math.hypot(clientX - fromX, clientY - fromY) > MAX_TAP_PX) return; // it turned the view
      stage.tap(offsetX / canvas.clientWidth, offsetY / canvas.clientHeight);
    });
    sketch.onDrawn = () => {
      if (this.latest) { canvas.classList.remove("gone"); stage.frame.classList.add("behind"); }
      this.painted();
    };
  }

  get slow() {
    const { times, stage } = this;
    const sum = times.reduce((a, b) => a + b, 0);
    if (times.length < MEASURED) return stage.bundle !== null && stage.bundle.header.chain.modules >= MANY && isSoftware();
    return (sum - Math.max(...times)) / (MEASURED - 1) > SLOW_MS;
  }

  // The view takes over when its first picture can be seen.
  takeOver() {
    if (this.asked || !this.given || !this.stage.open) return;
    this.asked = true;
    this.stage.painted(() => this.open());
  }

  open() {
    this.opened = true;
    this.onOpen();
    if (!this.slow || !this.given || !this.sketch.worker) { this.leave(); return; }
    this.latest = this.given;
    this.canvas.classList.add("standing-in");
    this.rest();
  }

  /**
   * @param {Snapshot} shown
   * @param {Uint8Array} colours
   * @param {Eye} eye
   */
  draw(shown, colours, eye) {
    const { stage, sketch } = this;
    stage.drawn = eye;
    if (!this.opened) {
      this.given = [shown, colours, eye];
      // The view needs a picture to begin with; one that takes seconds for it gets no more of them.
      if (!this.slow || !this.begun) { stage.draw(shown, colours, eye); this.begun = stage.open; }
      sketch.draw(shown, colours, eye, stage.ground);
      this.takeOver();
      return;
    }
    this.canvas.classList.remove("fading");
    if (!this.slow || stage.through || !sketch.worker) {
      stage.draw(shown, colours, eye);
      this.measure();
      if (this.latest) this.yield();
      return;
    }
    this.latest = [shown, colours, eye];
    stage.rest();
    sketch.draw(shown, colours, eye, stage.ground);
    this.canvas.classList.add("standing-in");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST_MS);
  }

  // The drawing goes, in a fade where both show the same: of what moves it would leave a ghost.
  leave() {
    this.canvas.classList.toggle("fading", !this.busy());
    this.canvas.classList.add("gone");
  }

  // Nothing has moved for a while: the view shows the same.
  rest() {
    if (this.busy()) { this.timer = setTimeout(() => this.rest(), REST_MS); return; }
    if (this.latest) this.stage.draw(...this.latest);
    this.measure();
    this.yield();
  }

  // The drawing goes when what the view was given can be seen, unless it has to stand in again.
  yield() {
    const { latest } = this;
    clearTimeout(this.timer);
    this.stage.frame.classList.remove("behind");
    this.stage.painted(() => {
      if (this.latest !== latest) return;
      this.latest = null;
      this.stage.frame.classList.remove("behind");
      this.canvas.classList.remove("standing-in");
      this.leave();
    });
  }

  // How long the view takes to show what it was just given.
  measure() {
    const begun = performance.now();
    const told = !this.measuring;
    this.measuring = true;
    this.stage.passed(() => {
      if (told) {
        this.measuring = false;
        if (!document.hidden) this.times = [...this.times, performance.now() - begun].slice(-MEASURED);
      }
      this.painted();
    });
  }
}
