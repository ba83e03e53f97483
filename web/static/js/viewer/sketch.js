// 2D drawing of a fold in a worker: available at once and without WebGL.

import { at as hrefOf } from "../lib/text.js";

// Colours of the table by theme. The drawing uses `top` and `edge`;
// `lit` gives the same colour under the lights of the 3D view.
/** @type {Record<"light" | "dark", { lit: Colour, top: Colour, edge: Colour }>} */
const COLOURS = {
  // As web/pictures/table_top.py.
  light: { lit: [206, 190, 166], top: [222, 214, 200], edge: [184, 172, 152] },
  dark: { lit: [62, 68, 77], top: [76, 83, 93], edge: [50, 56, 64] },
};
// Return the colours of the table in the current theme.
export function tableColours() {
  const { theme } = document.documentElement.dataset;
  return COLOURS[
    theme === "light" || theme === "dark"
      ? theme
      : matchMedia("(prefers-color-scheme: light)").matches
        ? "light"
        : "dark"
  ];
}

// Return the radial gradient in the background of an element: its size and centre as fractions, and
// its colours; null if the background is of another kind.
/**
 * @param {Element} element
 * @returns {Ground | null}
 */
function gradientOf(element) {
  const text = getComputedStyle(element).backgroundImage;
  const place = /^radial-gradient\(([\d.]+)% ([\d.]+)% at ([\d.]+)% ([\d.]+)%/
    .exec(text)
    ?.slice(1)
    .map((v) => Number(v) / 100);
  const stops = [...text.matchAll(/(rgba?\([^)]*\)) ([\d.]+)%/g)].map(
    ([, colour, at]) => /** @type {[number, string]} */ ([Number(at) / 100, colour]),
  );
  return place && stops.length ? { place, stops } : null;
}

// Return the height of the ground, in pitches: just below the visible part of the chain.
/** @param {Pick<Snapshot, "positions" | "framed">} snapshot */
export function floorUnder({ positions, framed }) {
  let low = Infinity;
  for (let k = 2; k < 3 * framed; k += 3) low = Math.min(low, positions[k]);
  return low - 0.5 - GROUND_GAP;
}

const GROUND_GAP = 0.35; // pitches
const MAX_SIDE_PX = 8192; // maximum side of a picture; some browsers have no larger canvases

export class Sketch {
  static script = hrefOf("/static/js/viewer/sketch_worker.js");

  // `onFirst` is called after the first frame is drawn.
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {() => void} onFirst
   */
  constructor(canvas, onFirst = () => {}) {
    this.canvas = canvas;
    /** @type {Ground | null} */
    this.painted = null; // background gradient
    this.onDrawn = () => {};
    this.waiting = false;
    /** @type {((png: Blob) => void)[]} */
    this.pictures = []; // callbacks of pending pictures
    /** @type {((image: ImageBitmap) => void)[]} */
    this.films = []; // callbacks of pending pictures of a film
    /** @type {SketchFrame | null} */
    this.next = null;
    this.pitch = 1;
    const paper = canvas.transferControlToOffscreen();
    // A classic worker: browsers refuse module workers to pages that are opened as files.
    this.worker = new Worker(Sketch.script);
    let first = true;
    this.worker.onmessage = ({ data }) => {
      if (data instanceof Blob) {
        this.pictures.shift()?.(data);
        return;
      }
      if (data instanceof ImageBitmap) {
        this.films.shift()?.(data);
        return;
      }
      if (first) {
        first = false;
        onFirst();
      }
      this.onDrawn();
      this.waiting = false;
      if (this.next) {
        const next = this.next;
        this.next = null;
        this.post(next);
      }
    };
    this.tell({ is: "begin", paper, size: this.size(), ...this.colours() }, [paper]);
    addEventListener("themechange", () => this.tell({ is: "dress", ...this.colours() }));
    new ResizeObserver(() => this.tell({ is: "size", size: this.size() })).observe(canvas);
  }

  /**
   * @param {SketchTold} message
   * @param {Transferable[]} transfer
   */
  tell(message, transfer = []) {
    this.worker.postMessage(message, transfer);
  }

  // Move the background of the canvas into the drawing. An opaque canvas saves the browser the
  // compositing, which would take longer than all the rest with software rendering.
  ground() {
    this.canvas.style.background = "";
    const gradient = gradientOf(this.canvas);
    this.painted = gradient;
    if (gradient) this.canvas.style.background = "none";
    return gradient;
  }

  /** @param {Bundle} bundle */
  set({ header, neighbours }) {
    this.pitch = header.pitch;
    this.tell({
      is: "outline",
      outline: {
        ...header.sketch,
        neighbours: neighbours ?? null,
        rods: header.chain.cells,
        full: 1 / header.shown_size,
        table: header.table,
      },
    });
  }

  // Return the colours of background and table in the current theme.
  colours() {
    return { ground: this.ground(), wood: tableColours() };
  }

  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   */
  draw(snapshot, colours, view, ground) {
    const frame = this.frame(snapshot, colours, view, ground);
    // A newer frame replaces a waiting one.
    if (this.waiting) this.next = frame;
    else this.post(frame);
  }

  /**
   * @param {Snapshot} snapshot
   * @param {Uint8Array} colours
   * @param {Eye} view
   * @param {number | null} ground
   * @returns {SketchFrame}
   */
  frame(snapshot, colours, { position, target }, ground) {
    const { positions, wxyzs, core = 0, rod = Infinity } = snapshot;
    const [eye, at] = [position, target].map((place) => place.map((v) => v / this.pitch));
    return {
      positions,
      wxyzs,
      colours,
      eye,
      target: at,
      floor: ground === null ? floorUnder(snapshot) : ground / this.pitch,
      core,
      rod,
    };
  }

  // Return the view as a PNG, `scale` times as large as on the page.
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

  // Set the pictures of texts that a film shows.
  /** @param {ImageBitmap[]} images */
  setTexts(images) {
    this.tell({ is: "texts", images }, images);
  }

  // Return one picture of a film, with labels.
  /**
   * @param {[shown: Snapshot, colours: Uint8Array, view: Eye, ground: number | null]} drawn
   * @param {{ width: number, height: number, ground: Ground, labels: Label[] }} film
   * @returns {Promise<ImageBitmap>}
   */
  filmed(drawn, { width, height, ground, labels }) {
    const frame = this.frame(...drawn);
    const size = { width, height, scale: 1 };
    return new Promise((done) => {
      this.films.push(done);
      this.tell({ is: "film", frame, size, ground, labels });
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
