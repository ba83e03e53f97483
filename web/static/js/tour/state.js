// State of a tour during editing and playback, without
// the page; see docs/tours.md. Frames count from 1.

export const FORMAT = "foldback-tour/1";
export const MAX_STOPS = 50;
export const MAX_CAPTION = 300;
const MAX_UNDONE = 100;
// Reading time of a caption: a constant, and a time for each character.
const READING_S = 1;
const READING_CHARACTER_S = 0.055;
// Minimum and maximum duration of the motion between two
// stops, and its frames per second in between.
const MOVING_S = [1, 6];
const MOVING_FPS = 90;

/** @param {string} caption */
export const readingSeconds = (caption) => READING_S + READING_CHARACTER_S * caption.length;

/** @param {number} frames */
export const movingSeconds = (frames) =>
  Math.min(MOVING_S[1], Math.max(MOVING_S[0], Math.abs(frames) / MOVING_FPS));

// Interpolate between two frames, with ease-in and ease-out, at a fraction of the time.
/**
 * @param {number} from
 * @param {number} to
 * @param {number} share
 */
export function frameBetween(from, to, share) {
  const t = Math.min(1, Math.max(0, share));
  return from + (to - from) * t * t * (3 - 2 * t);
}

export class TourState {
  /** @param {Tour} tour */
  constructor(tour) {
    this.tour = tour;
    this.saved = JSON.stringify(tour);
    this.at = 0;
    /** @type {{ tour: Tour, at: number }[]} */
    this.undone = []; // states for undo, the latest first
  }

  get stops() {
    return this.tour.stops;
  }

  get stop() {
    return this.stops[this.at];
  }

  get changed() {
    return JSON.stringify(this.tour) !== this.saved;
  }

  get full() {
    return this.stops.length >= MAX_STOPS;
  }

  // Go to a stop, or to the nearest existing one. Return true if the stop changes.
  /** @param {number} at */
  go(at) {
    const before = this.at;
    this.at = Math.min(Math.max(at, 0), this.stops.length - 1);
    return this.at !== before;
  }

  /**
   * @param {TourStop[]} stops
   * @param {number} at
   */
  change(stops, at) {
    this.undone = [{ tour: this.tour, at: this.at }, ...this.undone].slice(0, MAX_UNDONE);
    this.tour = { ...this.tour, stops };
    this.at = at;
  }

  // Add a stop after the current one.
  /** @param {TourStop} stop */
  add(stop) {
    if (this.full) return false;
    this.change(this.stops.toSpliced(this.at + 1, 0, stop), this.at + 1);
    return true;
  }

  // Remove a stop; a tour keeps at least one.
  /** @param {number} at */
  remove(at) {
    if (this.stops.length < 2) return false;
    this.change(this.stops.toSpliced(at, 1), Math.min(at, this.stops.length - 2));
    return true;
  }

  // Move a stop by some positions.
  /**
   * @param {number} at
   * @param {number} by
   */
  move(at, by) {
    const to = at + by;
    if (to < 0 || to >= this.stops.length) return false;
    this.change(this.stops.toSpliced(at, 1).toSpliced(to, 0, this.stops[at]), to);
    return true;
  }

  // Change the caption of a stop; ignore blank ones.
  /**
   * @param {number} at
   * @param {string} text
   */
  edit(at, text) {
    const caption = text.replace(/\s+/g, " ").trim().slice(0, MAX_CAPTION);
    if (!caption || caption === this.stops[at].caption) return false;
    this.change(this.stops.with(at, { ...this.stops[at], caption }), at);
    return true;
  }

  // Replace the stops, for example by a draft.
  /** @param {Tour} tour */
  replace(tour) {
    this.change(tour.stops, 0);
  }

  undo() {
    const [last, ...earlier] = this.undone;
    if (!last) return false;
    Object.assign(this, {
      tour: last.tour,
      at: Math.min(last.at, last.tour.stops.length - 1),
      undone: earlier,
    });
    return true;
  }

  // Mark the current tour as saved.
  keep() {
    this.saved = JSON.stringify(this.tour);
  }
}
