// Sentences about whether given motors are strong enough for a fold.
import { newtonMetres, seconds, si } from "../lib/text.js";

const DIGITS = 3;

/**
 * Answer of `/api/folds/ID/motors`.
 * @typedef {object} MotorsTold
 * @property {boolean | null} would_do null if no motor torque was given
 * @property {number | null} motor_torque_nm
 * @property {{ name: string, peak_torque_nm: number, peak_time_s: number,
 *   would_do: boolean | null }[]} joints
 */

// Round a torque up, so that a motor with the displayed torque is strong enough.
/** @param {number} value */
function roundedUp(value) {
  if (!(value > 0)) return 0;
  const [mantissa, exponent] = value.toExponential(9).split("e").map(Number);
  return Number(`${Math.ceil(mantissa * 10 ** (DIGITS - 1))}e${exponent - DIGITS + 1}`);
}

/** @param {MotorsTold} told */
export function motorWords({ would_do: enough, motor_torque_nm: torqueNm, joints }) {
  const neediest = joints.reduce((weakest, joint) =>
    joint.peak_torque_nm > weakest.peak_torque_nm ? joint : weakest,
  );
  const need = si(roundedUp(neediest.peak_torque_nm), "N·m", DIGITS);
  const peakWords =
    `${neediest.name} needs the highest torque ` +
    `(${need}) ${seconds(neediest.peak_time_s)} after the motion starts.`;
  if (torqueNm === null || enough === null)
    return `Motors with a torque of ${need} or more are strong enough. ${peakWords}`;
  if (enough) return `Yes, ${newtonMetres(torqueNm)} is enough. ${peakWords}`;
  const weak = joints.filter((joint) => joint.would_do === false).length;
  return (
    `No, ${newtonMetres(torqueNm)} is not enough for ${weak} of ${joints.length} hinges. ` +
    `${peakWords} Choose stronger motors, lighter modules or a slower motion.`
  );
}
