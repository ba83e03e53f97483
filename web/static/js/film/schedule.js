// Frames of a film: which moment of the timeline each picture shows, and which stop of the tour.
// `schedule` of web/movies/make_movie.py does the same for films of the service.

export const FPS = 30;
// Rests at both ends of a film, in seconds, and the largest fractions of the film that they take.
const START_REST = [0.4, 0.05];
const END_REST = [1.2, 0.15];
const MAX_READING_SHARE = 0.6; // of the film
const MIN_READING_S = 1.5;
const CHARACTERS_PER_S = 17; // the usual limit for subtitles

/** @param {string} caption */
export const readingSeconds = (caption) =>
  Math.max(MIN_READING_S, caption.length / CHARACTERS_PER_S);

/** @param {number} seconds */
export const countOf = (seconds) => Math.max(1, Math.round(seconds * FPS));

/**
 * @typedef {{ frames: Float64Array, stops: (TourStop | null)[] }} Schedule fractional frame and
 *   stop of each picture; no stop before the first one
 */

// Return the schedule of a film that moves evenly from one frame to another, and rests at both ends
// and at each stop of the tour between them.
/**
 * @param {{ first: number, last: number, seconds: number, stops?: TourStop[] }} film frames count
 *   from 0, except in stops
 * @returns {Schedule}
 */
export function schedule({ first, last, seconds, stops = [] }) {
  const shown = stops
    .filter(({ frame }) => frame - 1 >= first && frame - 1 <= last)
    .sort((a, b) => a.frame - b.frame);
  const reading = shown.map(({ caption }) => readingSeconds(caption));
  const needed = reading.reduce((sum, s) => sum + s, 0);
  const shorter = Math.min(1, (MAX_READING_SHARE * seconds) / Math.max(needed, 1e-9));
  const rest = (/** @type {number[]} */ [most, share]) => Math.min(most, share * seconds);
  const places = [first, ...shown.map(({ frame }) => frame - 1), last];
  const rests = [rest(START_REST), ...reading.map((s) => s * shorter), rest(END_REST)];
  const count = countOf(seconds);
  const resting = rests.reduce((sum, s) => sum + s, 0);
  const moving = Math.max((count - 1) / FPS - resting, 1e-9);
  const pace = moving / Math.max(last - first, 1e-9); // seconds per frame
  // Arrival at each place, in seconds.
  const arrivals = [0];
  for (let k = 1; k < places.length; k++)
    arrivals.push(arrivals[k - 1] + rests[k - 1] + pace * (places[k] - places[k - 1]));
  const frames = new Float64Array(count);
  /** @type {(TourStop | null)[]} */
  const reached = [];
  let at = 0;
  for (let k = 0; k < count; k++) {
    const time = k / FPS;
    while (at < places.length - 1 && time >= arrivals[at + 1] - 1e-9) at++;
    const share = Math.max(0, time - arrivals[at] - rests[at]) / pace;
    frames[k] = Math.min(places[at] + share, places[Math.min(at + 1, places.length - 1)]);
    reached.push(at && shown.length ? shown[Math.min(at, shown.length) - 1] : null);
  }
  return { frames, stops: reached };
}
