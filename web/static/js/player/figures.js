// Per-frame figures that are computed after a fold: clearances, torques, position errors.
import { Emitter, RefusedError, Source } from "./timeline.js";
import { at } from "../lib/text.js";

const KEPT = 24; // cached parts
const AT_ONCE = 2; // concurrent requests
const RETRY_MS = 2000;
const MAX_TRIES = 30; // requests for the curves, if the service is busy with others

export class Figures extends Emitter {
  /** @param {string} id */
  constructor(id) {
    super();
    this.source = new Source(at(`/folds/${id}`));
    /** @type {Curves | null} */
    this.plots = null;
    /** @type {Map<number, FigurePart>} */
    this.parts = new Map();
    /** @type {Set<number>} */
    this.loading = new Set();
    this.asked = false;
  }

  /**
   * @template {Message<object, Record<string, Column>>} [Told=Message<PlotHeader, Record<PlotName,
   *   Floats>>]
   * @param {string} query
   * @returns {Promise<Told | null>}
   */
  get(query) {
    return this.source.get(`figures${query}`);
  }

  // Fetch the curves of the plots, which the service computes on the first request; report
  // "computing" and then "begun", or "missing" if there are no figures.
  async begin() {
    if (this.asked) return;
    this.asked = true;
    this.tell("computing");
    const plots = await this.curves();
    if (!plots) {
      this.asked = false;
      this.tell("missing");
      return;
    }
    this.plots = { ...plots.header, ...plots.arrays };
    this.tell("begun");
  }

  // Return the curves; null if there are none, or if too many requests were refused.
  async curves() {
    for (let tries = 0; tries < MAX_TRIES; tries++) {
      try {
        return await this.get("");
      } catch (error) {
        if (!(error instanceof RefusedError)) return null;
        const { pauseMs } = error;
        await new Promise((resolve) => setTimeout(resolve, pauseMs));
      }
    }
    return null;
  }

  // True while the service computes them.
  get pending() {
    return this.asked && !this.plots;
  }

  // True if there are values of single modules.
  /** @param {FigureName} name */
  offers(name) {
    return Boolean(this.plots && name);
  }

  /** @param {FigureName} name */
  largest(name) {
    return this.plots?.largest[name] ?? 0;
  }

  // Return the figures of one frame; null until they are loaded, which the event `loaded` reports.
  /**
   * @param {number} frame
   * @returns {FigureRow | null}
   */
  row(frame) {
    if (!this.plots || frame >= this.plots.frames) return null;
    const { rows } = this.plots;
    const index = Math.floor(frame / rows);
    const part = this.parts.get(index);
    if (!part) {
      this.load(index);
      return null;
    }
    const k = frame - index * rows;
    const widths = /** @type {[FigureName, number][]} */ (Object.entries(part.header.widths));
    return Object.fromEntries(
      widths.map(([name, width]) => [
        name,
        part.arrays[name]?.subarray(k * width, (k + 1) * width),
      ]),
    );
  }

  /** @param {number} index */
  async load(index) {
    if (this.loading.has(index) || this.loading.size >= AT_ONCE) return;
    this.loading.add(index);
    /** @type {Promise<FigurePart | null>} */
    const request = this.get(`?part=${index}`);
    const part = await request.catch(() => null);
    if (!part) {
      setTimeout(() => this.loading.delete(index), RETRY_MS);
      return;
    }
    this.loading.delete(index);
    this.parts.set(index, part);
    if (this.parts.size > KEPT) this.parts.delete([...this.parts.keys()][0]);
    this.tell("loaded");
  }
}
