// A fold drawn by the page itself, in a worker: at once, and without WebGL.

import { at as hrefOf } from "../lib/text.js";

// Colours of the table that a chain folds on, by the page's theme.
// `top` and `edge` are what the drawing has, `lit` what becomes the same in the 3D view's light.
/** @type {Record<"light" | "dark", { lit: Colour, top: Colour, edge: Colour }>} */
const COLOURS = {
  light: { lit: [206, 190, 166], top: [222, 214, 200], edge: [184, 172, 152] }, // as web/pictures/table_top.py
  dark: { lit: [62, 68, 77], top: [76, 83, 93], edge: [50, 56, 64] },
};
// What the table looks like now.
export function tableColours() {
  const { theme } = document.documentElement.dataset;
  return COLOURS[theme === "light" || theme === "dark" ? theme : matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"];
}

// The radial gradient that an element has for a ground: its size and place in shares, and its colours;
// null when it has another.
/** @param {Element} element */
function gradientOf(element) {
  const text = getComputedStyle(element).backgroundImage;
  const place = /^radial-gradient\(([\d.]+)% ([\d.]+)% at ([\d.]+)% ([\d.]+)%/.exec(text)?.slice(1).map((v) => Number(v) / 100);
  const stops = [...text.matchAll(/(rgba?\([^)]*\)) ([\d.]+)%/g)].map(([, colour, at]) => [Number(at) / 100, colour]);
  return place && stops.length ? { place, stops } : null;
}

const MAX_SIDE_PX = 8192; // of a picture; browsers have no larger canvases everywhere

export class Sketch {
  static script = hrefOf("/static/js/viewer/sketch_worker.js");

  // Calls `onFirst` when the first frame has been drawn.
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {() => void} onFirst
   */
  constructor(canvas, onFirst = () => {}) {
    this.canvas = canvas;
    /** @type {ReturnType<typeof gradientOf>} */
    this.painted = null; // the ground
    this.onDrawn = () => {};
    /** @type {Worker | null} */
    this.worker = null;
    this.waiting = false;
    /** @type {((png: Blob) => void)[]} */
    this.pictures = []; // who waits for one
    /** @type {ArrayBuffer | null} */
    this.next = null;
    this.pitch = 1;
    /** @type {TableTold | null} */
    this.table = null;
    if (!canvas.transferControlToOffscreen || !window.Worker) return;
    const paper = canvas.transferControlToOffscreen();
    // No module: browsers refuse those to a page that was opened as a file.
    const worker = new Worker(Sketch.script);
    this.worker = worker;
    let first = true;
    worker.onmessage = ({ data }) => {
      if (data instanceof Blob) { this.pictures.shift()?.(data); return; }
      if (first) { first = false; onFirst(); }
      this.onDrawn();
      this.waiting = false;
      if (this.next) { const next = this.next; this.next = null; this.post(next); }
    };
    worker.postMessage({ is: "begin", paper, size: this.size(), ground: this.ground() }, [paper]);
    addEventListener("themechange", () => { this.dress(); worker.postMessage({ is: "ground", ground: this.ground() }); });
    new ResizeObserver(() => worker.postMessage({ is: "size", size: this.size() })).observe(canvas);
  }

  // A ground that the drawing has in it covers what is behind, which the browser then need not put
  // together: that would take longer than all the rest where graphics are software.
  ground() {
    this.canvas.style.background = "";
    const found = gradientOf(this.canvas);
    this.painted = found;
    if (found) this.canvas.style.background = "none";
    return found;
  }

  /** @param {Bundle} bundle */
  set({ header, neighbours }) {
    this.pitch = header.pitch;
    this.table = header.table;
    this.worker?.postMessage({ is: "outline", outline: {
      ...header.sketch, neighbours: neighbours ?? null, rods: header.chain.cells, full: 1 / header.shown_size, table: header.table,
    } });
    this.dress();
  }

  // The table in the colours of the page.
  dress() { if (this.table) this.worker?.postMessage({ is: "table", colours: tableColours() }); }

  /**
   * @param {Snapshot} shown
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   */
  draw(shown, colours, view, ground) {
    if (!this.worker) return;
    const data = this.numbers(shown, colours, view, ground);
    // A newer frame replaces one that still waits.
    if (this.waiting) this.next = data; else this.post(data);
  }

  // Little-endian float32: the camera's place, what it looks at and the height of the ground, how many
  // modules are folded and which is the first of the straight ones, then centre and orientation of each
  // module, in pitches; then the colours.
  /**
   * @param {Snapshot} shown
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   */
  numbers({ positions, wxyzs, framed, core = 0, rod = Infinity }, colours, view, ground) {
    const n = positions.length / 3;
    const data = new ArrayBuffer(4 * (9 + 7 * n) + 3 * n);
    const numbers = new Float32Array(data, 0, 9 + 7 * n);
    numbers.set(view.position.map((v) => v / this.pitch), 0);
    numbers.set(view.target.map((v) => v / this.pitch), 3);
    let low = Infinity;
    for (let i = 0; i < n; i++) {
      for (let k = 0; k < 3; k++) numbers[9 + 7 * i + k] = positions[3 * i + k];
      for (let k = 0; k < 4; k++) numbers[12 + 7 * i + k] = wxyzs[4 * i + k];
      if (i < framed) low = Math.min(low, positions[3 * i + 2]);
    }
    numbers[6] = ground === null ? low - 0.85 : ground / this.pitch;
    numbers[7] = core;
    numbers[8] = Math.min(rod, n);
    new Uint8Array(data, 4 * numbers.length).set(colours);
    return data;
  }

  // The view as a PNG, `scale` times as large as on the page.
  /**
   * @param {[shown: Snapshot, colours: Uint8Array, view: Eye, ground: number | null]} drawn
   * @param {{ scale: number, transparent: boolean }} options
   * @returns {Promise<Blob>}
   */
  picture(drawn, { scale, transparent }) {
    const { width, height } = this.size();
    const size = { width, height, scale: Math.min(scale, MAX_SIDE_PX / Math.max(width, height)) };
    const data = this.numbers(...drawn);
    return new Promise((done) => {
      this.pictures.push(done);
      this.worker?.postMessage({ is: "picture", data, size, ground: transparent ? null : this.painted }, [data]);
    });
  }

  /** @param {ArrayBuffer} data */
  post(data) {
    this.waiting = true;
    this.worker?.postMessage({ is: "frame", data }, [data]);
  }

  size() {
    const { clientWidth, clientHeight } = this.canvas;
    return { width: clientWidth, height: clientHeight, scale: Math.min(2, devicePixelRatio || 1) };
  }
}
