// A fold drawn by the page itself: at once, without WebGL, and beside the page's own thread.
export class Sketch {
  // Calls `onFirst` when the first frame has been drawn.
  constructor(canvas, id, visitor, onFirst = () => {}) {
    this.canvas = canvas;
    if (!canvas.transferControlToOffscreen || !window.Worker) return;
    const socket = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/folds/${id}/sketch/${visitor}`;
    const paper = canvas.transferControlToOffscreen();
    this.worker = new Worker("/static/drawing.js", { type: "module" });
    this.worker.onmessage = () => onFirst();
    this.worker.postMessage({ is: "begin", paper, socket, size: this.size() }, [paper]);
    this.watcher = new ResizeObserver(() => this.worker?.postMessage({ is: "size", size: this.size() }));
    this.watcher.observe(canvas);
  }

  size() {
    const { clientWidth, clientHeight } = this.canvas;
    return { width: clientWidth, height: clientHeight, scale: Math.min(2, devicePixelRatio || 1) };
  }

  stop() {
    this.watcher?.disconnect();
    this.worker?.terminate();
    this.worker = null;
  }
}
