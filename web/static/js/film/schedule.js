// Times of a film: which moment of the timeline each picture shows, and which stop of the tour.
import { angleIn, differing } from "../player/frames.js";

export const FPS = 30;
// Rests at both ends of a film, in seconds, and the largest fractions of the film that they take.
const START_REST = [0.4, 0.05];
const END_REST = [2, 0.22];
const MAX_READING_SHARE = 0.6; // of the film
const MIN_READING_S = 1.5;
const CHARACTERS_PER_S = 17; // the usual limit for subtitles
const SAMPLES = 240; // frames between which the rotations of hinges are measured
// Fraction of the moving time that passes evenly with the frames, so that a film never jumps.
const EVEN_SHARE = 0.2;

/** @param {string} caption */
export const readingSeconds = (caption) =>
  Math.max(MIN_READING_S, caption.length / CHARACTERS_PER_S);

/** @param {number} seconds */
export const countOf = (seconds) => Math.max(1, Math.round(seconds * FPS));

/**
 * @typedef {{ frames: number[], shares: number[] }} Pace frames in order, and the share of the
 *   moving time that has passed at each
 */

// Return the pace at which hinges rotate evenly. A timeline bends a straight chain slowly, and
// most hinges turn in its last frames: there a film needs its time.
/**
 * @param {Pick<import("../player/timeline.js").Timeline, "nearest" | "row">} timeline
 * @param {number} first
 * @param {number} last
 * @returns {Pace}
 */
export function paceOf(timeline, first, last) {
  const loaded = Array.from({ length: SAMPLES + 1 }, (_, k) =>
    timeline.nearest(Math.round(first + ((last - first) * k) / SAMPLES)),
  );
  const between = loaded.filter((frame) => frame !== null && frame > first && frame < last);
  const frames = [first, ...new Set(/** @type {number[]} */ (between)), last];
  const rotations = [0];
  for (let k = 1; k < frames.length; k++)
    rotations.push(rotations[k - 1] + rotation(timeline, frames[k - 1], frames[k]));
  const total = rotations[rotations.length - 1];
  const shares = frames.map((frame, k) => {
    const even = (frame - first) / Math.max(last - first, 1);
    return total ? EVEN_SHARE * even + (1 - EVEN_SHARE) * (rotations[k] / total) : even;
  });
  return { frames, shares };
}

// Return the sum of the rotations of all hinges from one frame to another, in rad.
/**
 * @param {Pick<import("../player/timeline.js").Timeline, "nearest" | "row">} timeline
 * @param {number} from
 * @param {number} to
 */
function rotation(timeline, from, to) {
  const [a, b] = [from, to].map((frame) => timeline.row(timeline.nearest(frame) ?? 0));
  if (!a || !b) return 0;
  const [firstHinge, endHinge] = differing(a, b);
  let sum = 0;
  for (let j = firstHinge; j < endHinge; j++) sum += Math.abs(angleIn(b, j) - angleIn(a, j));
  return sum;
}

// Return the value at x of a piecewise linear function through points with rising xs.
/**
 * @param {number} x
 * @param {number[]} xs
 * @param {number[]} ys
 */
function interpolated(x, xs, ys) {
  const k = xs.findIndex((value) => value >= x);
  if (k < 0) return ys[ys.length - 1];
  if (k === 0 || xs[k] === x) return ys[k];
  return ys[k - 1] + ((ys[k] - ys[k - 1]) * (x - xs[k - 1])) / (xs[k] - xs[k - 1]);
}

/**
 * @typedef {{ frames: Float64Array, stops: (TourStop | null)[] }} Schedule fractional frame and
 *   stop of each picture; no stop before the first one
 */

// Return the schedule of a film that moves at a pace, and rests at both ends and at each stop of
// the tour between them. Films of the service move evenly: `schedule` of web/movies/make_movie.py.
/**
 * @param {{ pace: Pace, seconds: number, stops?: TourStop[] }} film frames count from 0, except
 *   in stops
 * @returns {Schedule}
 */
export function schedule({ pace: { frames: paced, shares }, seconds, stops = [] }) {
  const [first, last] = [paced[0], paced[paced.length - 1]];
  const shown = stops
    .filter(({ frame }) => frame - 1 >= first && frame - 1 <= last)
    .sort((a, b) => a.frame - b.frame);
  const reading = shown.map(({ caption }) => readingSeconds(caption));
  const needed = reading.reduce((sum, s) => sum + s, 0);
  const shorter = Math.min(1, (MAX_READING_SHARE * seconds) / Math.max(needed, 1e-9));
  const rest = (/** @type {number[]} */ [most, share]) => Math.min(most, share * seconds);
  const at = (/** @type {number} */ frame) => interpolated(frame, paced, shares);
  const places = [0, ...shown.map(({ frame }) => at(frame - 1)), at(last)];
  const rests = [rest(START_REST), ...reading.map((s) => s * shorter), rest(END_REST)];
  const count = countOf(seconds);
  const resting = rests.reduce((sum, s) => sum + s, 0);
  const moving = Math.max((count - 1) / FPS - resting, 1e-9);
  // Arrival at each place, in seconds.
  const arrivals = [0];
  for (let k = 1; k < places.length; k++)
    arrivals.push(arrivals[k - 1] + rests[k - 1] + moving * (places[k] - places[k - 1]));
  const frames = new Float64Array(count);
  /** @type {(TourStop | null)[]} */
  const reached = [];
  let place = 0;
  for (let k = 0; k < count; k++) {
    const time = k / FPS;
    while (place < places.length - 1 && time >= arrivals[place + 1] - 1e-9) place++;
    const passed = Math.max(0, time - arrivals[place] - rests[place]) / moving;
    const next = places[Math.min(place + 1, places.length - 1)];
    frames[k] = interpolated(Math.min(places[place] + passed, next), shares, paced);
    reached.push(place && shown.length ? shown[Math.min(place, shown.length) - 1] : null);
  }
  return { frames, stops: reached };
}
