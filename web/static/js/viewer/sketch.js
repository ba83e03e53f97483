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
/**
 * @param {Element} element
 * @returns {Ground | null}
 */
function gradientOf(element) {
  const text = getComputedStyle(element).backgroundImage;
  const place = /^radial-gradient\(([\d.]+)% ([\d.]+)% at ([\d.]+)% ([\d.]+)%/.exec(text)?.slice(1).map((v) => Number(v) / 100);
  const stops = [...text.matchAll(/(rgba?\([^)]*\)) ([\d.]+)%/g)].map(([, colour, at]) => /** @type {[number, string]} */ ([Number(at) / 100, colour]));
  return place && stops.length ? { place, stops } : null;
}

// The height of the ground, just below what is in view of the chain, in pitches.
/** @param {Pick<Snapshot, "positions" | "framed">} shown */
export function floorUnder({ positions, framed }) {
  let low = Infinity;
  for (let k = 2; k < 3 * framed; k += 3) low = Math.min(low, positions[k]);
  return low - 0.5 - GROUND_GAP;
}

const GROUND_GAP = 0.35; // pitches
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
    /** @type {Ground | null} */
    this.painted = null; // the ground
    this.onDrawn = () => {};
    this.waiting = false;
    /** @type {((png: Blob) => void)[]} */
    this.pictures = []; // who waits for one
    /** @type {SketchFrame | null} */
    this.next = null;
    this.pitch = 1;
    const paper = canvas.transferControlToOffscreen();
    // No module: browsers refuse those to a page that was opened as a file.
    this.worker = new Worker(Sketch.script);
    let first = true;
    this.worker.onmessage = ({ data }) => {
      if (data instanceof Blob) { this.pictures.shift()?.(data); return; }
      if (first) { first = false; onFirst(); }
      this.onDrawn();
      this.waiting = false;
      if (this.next) { const next = this.next; this.next = null; this.post(next); }
    };
    this.tell({ is: "begin", paper, size: this.size(), ...this.colours() }, [paper]);
    addEventListener("themechange", () => this.tell({ is: "dress", ...this.colours() }));
    new ResizeObserver(() => this.tell({ is: "size", size: this.size() })).observe(canvas);
  }

  /**
   * @param {SketchTold} message
   * @param {Transferable[]} given
   */
  tell(message, given = []) { this.worker.postMessage(message, given); }

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
    this.tell({ is: "outline", outline: {
      ...header.sketch, neighbours: neighbours ?? null, rods: header.chain.cells, full: 1 / header.shown_size, table: header.table,
    } });
  }

  // Of the ground and a table, as the page has them.
  colours() { return { ground: this.ground(), wood: tableColours() }; }

  /**
   * @param {Snapshot} shown
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   */
  draw(shown, colours, view, ground) {
    const frame = this.frame(shown, colours, view, ground);
    // A newer frame replaces one that still waits.
    if (this.waiting) this.next = frame; else this.post(frame);
  }

  /**
   * @param {Snapshot} shown
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   * @returns {SketchFrame}
   */
  frame(shown, colours, { position, target }, ground) {
    const { positions, wxyzs, core = 0, rod = Infinity } = shown;
    const [eye, at] = [position, target].map((place) => place.map((v) => v / this.pitch));
    return { positions, wxyzs, colours, eye, target: at, floor: ground === null ? floorUnder(shown) : ground / this.pitch, core, rod };
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
    const frame = this.frame(...drawn);
    return new Promise((done) => {
      this.pictures.push(done);
      this.tell({ is: "picture", frame, size, ground: transparent ? null : this.painted });
    });
  }

  /** @param {SketchFrame} frame */
  post(frame) {
    this.waiting = true;
    this.tell({ is: "frame", frame });
  }

  size() {
    const { clientWidth, clientHeight } = this.canvas;
    return { width: clientWidth, height: clientHeight, scale: Math.min(2, devicePixelRatio || 1) };
  }
}
