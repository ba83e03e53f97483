// Round numbers along an axis.
const MOST_TICKS = 5;
const DIGITS = 3;

export const round = (/** @type {number} */ value) => Number(value.toPrecision(DIGITS));

// Round numbers from low to high, a few of them; powers of ten and their halves on a log scale.
/**
 * @param {number} low
 * @param {number} high
 * @param {boolean} log
 * @param {number} most about the largest number of ticks
 */
export function ticks(low, high, log, most = MOST_TICKS) {
  if (log) {
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += 1) {
      for (const digit of [1, 2, 5]) found.push(round(digit * 10 ** power));
    }
    const inside = found.filter((value) => value >= low && value <= high);
    const tens = inside.filter((value) => Number.isInteger(round(Math.log10(value))));
    return inside.length > most && tens.length > 1 ? tens : inside;
  }
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((digit) => digit * power).find((wide) => wide >= rough) ?? rough;
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, k) => round((first + k) * step));
}
