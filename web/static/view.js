// The framed 3D view: keys go to our page, a touch of the camera ends following, and a viewer that
// was made anew is loaded anew.
const MOVED_PX = 4;

export class View {
  constructor(frame, { onKey, onTouch }) {
    this.frame = frame;
    this.onKey = onKey;
    this.onTouch = onTouch;
    this.dressed = null;
    frame.addEventListener("load", () => this.dress());
    this.dress();
  }

  reload() { this.frame.contentWindow.location.reload(); }

  dress() {
    const inside = this.frame.contentDocument;
    if (!inside || inside === this.dressed || inside.URL === "about:blank") return;
    this.dressed = inside;
    const view = this.frame.contentWindow;
    view.addEventListener("keydown", (event) => this.onKey(event), { capture: true });
    let start = null;
    view.addEventListener("pointerdown", (event) => { start = [event.clientX, event.clientY]; }, { capture: true });
    view.addEventListener("pointerup", () => { start = null; }, { capture: true });
    view.addEventListener("pointercancel", () => { start = null; }, { capture: true });
    view.addEventListener("pointermove", (event) => {
      if (!start || !event.buttons) return;
      if (Math.hypot(event.clientX - start[0], event.clientY - start[1]) > MOVED_PX) {
        start = null;
        this.onTouch();
      }
    }, { capture: true });
    view.addEventListener("wheel", () => this.onTouch(), { capture: true, passive: true });
  }
}

export function hasWebGL() {
  try {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context);
  } catch {
    return false;
  }
}
