// Who shows a fold: the 3D view, or the page's own drawing on top of it: until the view has started,
// and, where 3D graphics are software and take long for a picture, for as long as anything moves.
const SLOW_MS = 70; // for a picture; below it the view keeps up
const MEASURED = 4; // pictures, of which the slowest does not count: it may have compiled shaders
const MANY = 300; // modules, which software never shows in time
const REST_MS = 400;

export class StandIn {
  constructor(canvas, stage, sketch) {
    Object.assign(this, { canvas, stage, sketch });
    this.opened = false; // the view has taken over
    this.begun = false; // it has been given a picture
    this.given = null; // the latest one before it took over
    this.times = [];
    this.measuring = false;
    this.latest = null;
    this.timer = null;
    this.painted = () => {};
    this.busy = () => false; // whether more is to come by itself
    sketch.onDrawn = () => {
      if (this.latest) { canvas.classList.remove("gone"); stage.frame.classList.add("behind"); }
      this.painted();
    };
  }

  get slow() {
    const { times, stage } = this;
    const sum = times.reduce((a, b) => a + b, 0);
    if (times.length < MEASURED) return stage.scenery.header.chain.modules >= MANY && stage.software;
    return (sum - Math.max(...times)) / (MEASURED - 1) > SLOW_MS;
  }

  // The view is there. One that takes seconds for a picture is shown when it has one.
  open() {
    this.opened = true;
    if (!this.slow || !this.given || !this.sketch.worker) { this.canvas.classList.add("gone"); return; }
    this.latest = this.given;
    this.canvas.classList.add("standing-in");
    this.rest();
  }

  draw(shown, colours, view, follow) {
    const { stage, sketch } = this;
    if (!this.opened) {
      this.given = [shown, colours, follow ? view : null];
      // The view needs a picture to begin with; one that takes seconds for it gets no more of them.
      if (!this.slow || !this.begun) { stage.draw(shown, colours, follow ? view : null); this.begun = stage.open; }
      sketch.draw(shown, colours, view, stage.ground);
      return;
    }
    const seen = follow ? view : stage.camera;
    if (!this.slow || stage.through || !sketch.worker || !seen) {
      if (this.latest) this.stepAside();
      stage.draw(shown, colours, follow ? view : null);
      this.measure();
      return;
    }
    this.latest = [shown, colours, follow ? view : null];
    stage.rest();
    sketch.draw(shown, colours, seen, stage.ground);
    this.canvas.classList.add("standing-in");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST_MS);
  }

  // Nothing has moved for a while: the view shows the same, and is shown when it does.
  rest() {
    const { latest } = this;
    if (this.busy()) { this.timer = setTimeout(() => this.rest(), REST_MS); return; }
    this.stage.frame.classList.remove("behind");
    this.stage.draw(...latest);
    this.measure(() => {
      if (this.latest === latest) this.stepAside();
    });
  }

  stepAside() {
    clearTimeout(this.timer);
    this.latest = null;
    this.stage.frame.classList.remove("behind");
    this.canvas.classList.add("gone");
    this.canvas.classList.remove("standing-in");
  }

  // How long the view takes to show what it was just given.
  measure(then = () => {}) {
    const view = this.stage.frame.contentWindow;
    const begun = performance.now();
    const told = !this.measuring;
    this.measuring = true;
    view.requestAnimationFrame(() => view.requestAnimationFrame(() => {
      if (told) {
        this.measuring = false;
        if (!document.hidden) this.times = [...this.times, performance.now() - begun].slice(-MEASURED);
      }
      then();
      this.painted();
    }));
  }
}
