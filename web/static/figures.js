// Figures of a fold, frame by frame, that are worked out after it: clearances, torques, position errors.
import { decode } from "./columns.js";
import { Teller } from "./teller.js";

const KEPT = 24; // stretches
const AT_ONCE = 2;
const RETRY_MS = 2000;

export class Figures extends Teller {
  constructor(id) {
    super();
    this.under = `/folds/${id}/figures`;
    this.plots = null;
    this.parts = new Map();
    this.loading = new Set();
  }

  async get(query) {
    const answer = await fetch(`${this.under}${query}`);
    return answer.status === 200 ? decode(await answer.arrayBuffer()) : null;
  }

  // Looks whether they are there; what a plot draws comes with them.
  async begin() {
    if (this.plots) return true;
    const found = await this.get("").catch(() => null);
    if (!found) return false;
    this.plots = { ...found.header, ...found.arrays };
    this.tell("begun");
    return true;
  }

  largest(name) { return this.plots?.largest[name] ?? 0; }

  // The figures of one frame; null until they are here, which `loaded` tells.
  row(frame) {
    if (!this.plots || frame >= this.plots.frames) return null;
    const { rows } = this.plots;
    const index = Math.floor(frame / rows);
    const part = this.parts.get(index);
    if (!part) { this.load(index); return null; }
    const k = frame - index * rows;
    return Object.fromEntries(Object.entries(part.arrays).map(([name, values]) => {
      const width = part.header.widths[name];
      return [name, values.subarray(k * width, (k + 1) * width)];
    }));
  }

  async load(index) {
    if (this.loading.has(index) || this.loading.size >= AT_ONCE) return;
    this.loading.add(index);
    const found = await this.get(`?part=${index}`).catch(() => null);
    if (!found) { setTimeout(() => this.loading.delete(index), RETRY_MS); return; }
    this.loading.delete(index);
    this.parts.set(index, found);
    if (this.parts.size > KEPT) this.parts.delete(this.parts.keys().next().value);
    this.tell("loaded");
  }
}
