import assert from "node:assert/strict";
import { test } from "node:test";
import { announcementOf, headingOf, titleOf } from "../../../web/static/js/panels/outcome.js";

const facts = (tone) => ({ name: "torus", verdict: { tone, text: "" } });

test("title_while_a_fold_runs_shows_the_progress", () => {
  assert.equal(titleOf({ status: "running", stage: "explode", fraction: 0.429 }, "torus"), "42 % · torus · foldback");
  assert.equal(titleOf({ status: "running", stage: "read" }, "torus"), "0 % · torus · foldback");
  assert.equal(titleOf({ status: "queued", stage: "read", fraction: 0.4 }, "torus"), "Waiting · torus · foldback");
});

test("title_at_the_verdict_shows_a_mark", () => {
  assert.deepEqual(["good", "bad", "soft"].map((tone) => headingOf(facts(tone))), ["✓ torus", "✕ torus", "torus"]);
});

test("announcement_is_made_of_a_verified_fold_only", () => {
  assert.deepEqual(["good", "bad"].map((tone) => announcementOf(facts(tone))), ["✓ torus folds: verified", null]);
});
