// The measure of folding: 0 for the straight chain, 1 when all hinges have the angles of the shape. A
// plain sum of errors would stay at 0 while the chain bends everywhere on its way; this one rises steadily.

/** @typedef {import("./timeline.js").Timeline} Timeline */

// The mean over the hinges of angle / goal, each from 0 to 1 and weighted with |goal|.
/**
 * @param {(hinge: number) => number} angle
 * @param {Floats} goal
 */
export function foldedness(angle, goal) {
  let reached = 0;
  let all = 0;
  for (let j = 0; j < goal.length; j++) {
    const wanted = Math.abs(goal[j]);
    all += wanted;
    if (wanted) reached += Math.min(wanted, Math.max(0, angle(j) * Math.sign(goal[j])));
  }
  return all > 0 ? reached / all : 1;
}

// The frame of the fold with that share of folding, between two where need be; found by halving, of the
// frames that are here.
/**
 * @param {Timeline} timeline
 * @param {number} wanted
 */
export function frameFolded(timeline, wanted) {
  const folding = timeline.outline.phases.findLast(({ name }) => name === "playback");
  if (!folding) return null;
  const value = (/** @type {number} */ frame) => {
    const row = timeline.row(frame);
    return row && foldedness((j) => timeline.how.angle(row, j), timeline.foldedRad);
  };
  let [low, high] = [folding.from, folding.to - 1];
  if (wanted <= 0) return low;
  if (wanted >= 1) return high;
  let [less, more] = [value(low) ?? 0, value(high) ?? 1];
  while (high - low > 1) {
    const middle = hereBetween(timeline, low, high);
    if (middle === null) break;
    const found = value(middle) ?? 0;
    if (found < wanted) [low, less] = [middle, found];
    else [high, more] = [middle, found];
  }
  const share = more > less ? (wanted - less) / (more - less) : 1;
  return low + (high - low) * Math.min(1, Math.max(0, share));
}

// The frame that is here and nearest to the middle of two, without them.
/**
 * @param {Timeline} timeline
 * @param {number} low
 * @param {number} high
 */
function hereBetween(timeline, low, high) {
  const middle = Math.floor((low + high) / 2);
  for (let away = 0; middle - away > low || middle + away < high; away++) {
    if (middle + away < high && timeline.row(middle + away)) return middle + away;
    if (middle - away > low && timeline.row(middle - away)) return middle - away;
  }
  return null;
}
