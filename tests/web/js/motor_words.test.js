import assert from "node:assert/strict";
import { test } from "node:test";
import { motorWords } from "../../../web/static/js/panels/motor_words.js";

/**
 * @param {number | null} torque
 * @param {number} peak
 */
function told(torque, peak) {
  const joints = [["joint_1_y", 0.002], ["joint_2_y", peak]].map(([name, need]) => ({
    name: String(name), peak_torque_nm: Number(need), peak_time_s: 0.47, would_do: torque === null ? null : Number(need) <= torque,
  }));
  return { would_do: torque === null ? null : peak <= torque, motor_torque_nm: torque, joints };
}

test("without a motor the answer is what is needed, not a refusal", () => {
  assert.equal(motorWords(told(null, 201)), "Motors of 201 N·m or more are strong enough. joint_2_y needs most: 201 N·m, 0.47 s into the motion.");
});

test("what is needed is rounded up", () => {
  assert.match(motorWords(told(null, 201.2)), /^Motors of 202 N·m or more/);
});

test("a motor is judged in a sentence with a capital", () => {
  assert.match(motorWords(told(3, 0.5)), /^Yes, 3 N·m is enough\. joint_2_y needs most: 500 mN·m/);
  assert.match(motorWords(told(3, 501)), /^No, 3 N·m is too weak for 1 of 2 hinges\. joint_2_y needs most: 501 N·m/);
});
