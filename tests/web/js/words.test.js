import assert from "node:assert/strict";
import { test } from "node:test";
import { refusalWords } from "../../../web/static/js/lib/api.js";
import { factsOf, verdictOf } from "../../../web/static/js/panels/owned_cards.js";
import { remaining } from "../../../web/static/js/panels/overall_progress.js";
import {
  duration,
  newtonMetres,
  number,
  radians,
  si,
  integerText,
} from "../../../web/static/js/lib/text.js";
import { degrees } from "../../../web/static/js/panels/module_panel.js";
import { motorWords } from "../../../web/static/js/panels/motor_words.js";
import { vectors } from "./vectors.js";

test("figures have two significant digits, and missing ones say so", () => {
  assert.equal(integerText(1234567.4), "1\u2009234\u2009567");
  assert.deepEqual([null, 0, 7.1e-6, 0.00123].map(radians), [
    "no data for this frame",
    "0 rad",
    "7.1 µrad",
    "1.2 mrad",
  ]);
  assert.deepEqual(
    [Math.PI / 2, -0.5, -1e-9].map((v) => degrees(v)),
    ["90.0°", "−28.6°", "0.0°"],
  );
  assert.deepEqual([1.234, 3.4e-5, 501].map(newtonMetres), ["1.2 N·m", "34 µN·m", "500 N·m"]);
  assert.deepEqual([0.2, 89, 90, 5399, 7200].map(duration), [
    "about 1 s",
    "about 89 s",
    "about 2 min",
    "about 90 min",
    "about 2 h",
  ]);
});

test("a quantity has the same text in scripts and on the server", () => {
  for (const { value, digits, si: withPrefix, number: plain } of vectors.quantities) {
    assert.deepEqual(
      [si(value, "N·m", digits), number(value, digits)],
      [withPrefix, plain],
      `${value} to ${digits} digits`,
    );
  }
});

test("a refusal has the message of the service, or its detail", () => {
  const apart = { detail: "cells 1 and 2 are apart", where: "cells 1 and 2" };
  assert.equal(
    refusalWords({ ...apart, message: "cells 2 and 3 are apart" }, 422),
    "Cells 2 and 3 are apart",
  );
  assert.equal(refusalWords(apart, 422), "Cells 1 and 2 are apart");
});

test("a torque other than 0 is never shown as 0", () => {
  assert.deepEqual([0, 1e-7, 2.5e-10, 1e-15].map(newtonMetres), [
    "0 N·m",
    "100 nN·m",
    "250 pN·m",
    "< 1 pN·m",
  ]);
});

test("the remaining time is rounded to what can be known", () => {
  assert.deepEqual([0, 1, 4.4, 12, 23, 400].map(remaining), [
    "takes longer than usual",
    "a few seconds left",
    "a few seconds left",
    "about 12 s left",
    "about 25 s left",
    "about 7 min left",
  ]);
  assert.deepEqual(
    [0, 12].map((value) => remaining(value, true)),
    ["slow, because the computer is busy with other work", "about 12 s left"],
  );
});

test("a refusal without a message states the status", () => {
  assert.equal(
    refusalWords({}, 503),
    "The request failed: the server answered with status 503. Try again later.",
  );
});

/**
 * @param {number | null} torque
 * @param {number} peak
 */
function motors(torque, peak) {
  const joints = [
    ["joint_1_y", 0.002],
    ["joint_2_y", peak],
  ].map(([name, need]) => ({
    name: String(name),
    peak_torque_nm: Number(need),
    peak_time_s: 0.47,
    would_do: torque === null ? null : Number(need) <= torque,
  }));
  return { would_do: torque === null ? null : peak <= torque, motor_torque_nm: torque, joints };
}

test("without a motor the answer is the required torque, not a refusal", () => {
  assert.equal(
    motorWords(motors(null, 201)),
    "Motors with a torque of 201 N·m or more are strong enough. joint_2_y needs the highest torque (201 N·m) 0.47 s after the motion starts.",
  );
});

test("required figures are rounded up", () => {
  assert.match(motorWords(motors(null, 201.2)), /^Motors with a torque of 202 N·m or more/);
});

test("the judgement of a motor is a sentence", () => {
  assert.match(
    motorWords(motors(3, 0.5)),
    /^Yes, 3 N·m is enough\. joint_2_y needs the highest torque \(500 mN·m\)/,
  );
  assert.match(
    motorWords(motors(3, 501)),
    /^No, 3 N·m is not enough for 1 of 2 hinges\. joint_2_y needs the highest torque \(501 N·m\)/,
  );
});

test("the card of a fold names its state", () => {
  const texts = [
    { status: "queued", stage: null, summary: {}, progress: {} },
    { status: "running", stage: "explode", summary: {}, progress: { fraction: 0.429 } },
    { status: "verified", stage: "export", summary: {}, progress: {} },
  ].map((fold) => verdictOf(fold).text);
  assert.deepEqual(texts, ["In the queue", "Unfolding 42 %", "Verified"]);
});

test("the card of a fold says how much it is like its file", () => {
  const state = { created_at: new Date().toISOString(), public: true };
  const fold = {
    modules: 1600,
    module_words: { singular: "cube", plural: "cubes" },
    preset: "default",
    world: "table",
    ...state,
  };
  const facts = (summary) => factsOf({ ...fold, summary });
  assert.equal(
    facts({ likeness: { iou: 0.744 } }),
    "1\u2009600 cubes · 74\u00a0% like the file · on a table · just now · in the gallery",
  );
  assert.equal(facts({ likeness: null }), facts({}));
  assert.doesNotMatch(facts({}), /file/);
});
