// Where a step leads that is not told in frames: so much time on, or to the next change that one sees.
/** @typedef {import("./timeline.js").Timeline} Timeline */

const SEEN_RAD = 0.05; // a hinge that has turned by more shows it

// The frame so many seconds from one, between two where need be. Where frames are not here yet they are
// taken for as long as the last one that is.
/**
 * @param {Timeline} timeline
 * @param {number} frame
 * @param {number} seconds
 */
export function after(timeline, frame, seconds) {
  const way = Math.sign(seconds);
  const end = way > 0 ? timeline.last : 0;
  let here = frame;
  let left = Math.abs(seconds);
  let length = 0; // of a frame, in seconds
  while (left > 1e-9 && here !== end) {
    const low = way > 0 ? Math.floor(here) : Math.ceil(here) - 1;
    const [a, b] = [timeline.row(low), timeline.row(low + 1)];
    if (a && b) length = b.time_s - a.time_s;
    else if (!length) return Math.min(Math.max(here + way, 0), timeline.last); // nothing is known of these
    const share = way > 0 ? low + 1 - here : here - low; // of this frame that is still ahead
    if (share * length > left) return here + (way * left) / length;
    left -= share * length;
    here = way > 0 ? low + 1 : low;
  }
  return here;
}

// The next frame, `way` 1 on or -1 back, at which some hinge has turned by what one sees since this one,
// or another phase goes on; the first that is not here yet, or the end, when none is found before.
/**
 * @param {Timeline} timeline
 * @param {number} frame
 * @param {number} way
 */
export function nextChange(timeline, frame, way) {
  const { how, last } = timeline;
  const begin = way > 0 ? Math.floor(frame) : Math.ceil(frame);
  const from = timeline.row(begin);
  let k = begin + way;
  for (; from && k > 0 && k < last; k += way) {
    const row = timeline.row(k);
    if (!row || row.phase !== from.phase) break;
    const [first, end] = timeline.differing(from, row);
    let turned = 0;
    for (let j = first; j < end && turned <= SEEN_RAD; j++) turned = Math.abs(how.angle(row, j) - how.angle(from, j));
    if (turned > SEEN_RAD) break;
  }
  return Math.min(Math.max(k, 0), last);
}
