import assert from "node:assert/strict";
import { test } from "node:test";
import { OverallProgress, queueWords } from "../../../web/static/js/panels/overall_progress.js";
import { Progress } from "../../../web/static/js/panels/progress.js";
import { announcementOf, awaitOutcome, headingOf, titleOf } from "../../../web/static/js/panels/outcome.js";

const facts = (tone) => ({ name: "torus", verdict: { tone, text: "" } });

test("the title of a running fold shows its progress", () => {
  assert.equal(titleOf({ status: "running", stage: "explode", fraction: 0.429 }, "torus", "Exploding"), "Exploding 42 % · torus · foldback");
  assert.equal(titleOf({ status: "running", stage: "read" }, "torus", "Reading"), "Reading 0 % · torus · foldback");
  assert.equal(titleOf({ status: "queued", stage: "read", fraction: 0.4 }, "torus", "Reading"), "Waiting · torus · foldback");
});

test("the title shows the progress while solvers are prepared", () => {
  for (const status of ["queued", "running"]) {
    assert.equal(titleOf({ status, fraction: 0, preparing: { fraction: 0.478, remaining_s: 90 } }, "torus", "Reading"), "Preparing 47 % · torus · foldback");
  }
});

test("the title has a mark when there is a verdict", () => {
  assert.deepEqual(["good", "bad", "soft"].map((tone) => headingOf(facts(tone))), ["✓ torus", "✕ torus", "torus"]);
});

test("only a verified fold is announced", () => {
  assert.deepEqual(["good", "bad"].map((tone) => announcementOf(facts(tone))), ["✓ torus: fold verified", null]);
});

/** @param {[string, number, number][]} reports */
function after(reports) {
  const advance = new OverallProgress();
  return reports.map(([stage, fraction, simulated_s]) => {
    advance.note({ stage, fraction, simulated_s });
    return [advance.fraction, advance.simulatedS, advance.attempt];
  });
}

test("the progress of several robots never goes backwards", () => {
  assert.deepEqual(after([["play_back", 0.3, 30], ["play_back", 0.2, 26], ["play_back", 0.4, 36]]), [
    [0.3, 30, 1], [0.3, 30, 1], [0.4, 36, 1],
  ]);
});

test("an earlier stage begins another attempt", () => {
  assert.deepEqual(after([["explode", 0.9, 0], ["play_back", 0.1, 5], ["explode", 0.06, 0]]).at(-1), [0.06, 0, 2]);
});

test("a fold that waits gives its reason", () => {
  assert.deepEqual([0, 1, 2, 4].map((place) => queueWords(place)), [
    "In the queue", "Next in line", "In the queue, behind 1 other fold", "In the queue, behind 3 other folds",
  ]);
  assert.deepEqual([1, 3].map((place) => queueWords(place, 1)), [
    "Next in line, after the running fold", "In the queue, behind 3 other folds",
  ]);
});

test("a fold with a preference says how many plans there are", () => {
  const advance = new OverallProgress();
  advance.note({ stage: "explode", fraction: 0.1, plan: 1, plans: 10 });
  assert.equal(advance.words(), " · plan 1 of about 10");
  advance.note({ stage: "certify", fraction: 1, plan: 3, plans: 9 });
  advance.note({ stage: "explode", fraction: 0 }); // not counted yet
  assert.equal(advance.words(), " · plan 4 of about 9");
  advance.note({ stage: "explode", fraction: 0.2, plan: 11, plans: 10 });
  assert.equal(advance.words(), " · plan 11 of about 11");
});

test("a plan that is being smoothed is never called exploding", () => {
  const advance = new OverallProgress();
  const names = [["explode", "smoothing"], ["explode", "done"], ["play_back", ""], ["explode", ""]].map(([stage, message]) => {
    advance.note({ stage, message });
    return advance.name();
  });
  assert.equal(names[0], "Smoothing");
  assert.equal(names[1], "Smoothing");
  assert.notEqual(names[2], "Smoothing");
  assert.equal(names[3], "Exploding");
});

test("permission to notify is asked on a click only, and a hidden tab notifies once", async (t) => {
  const { document: page, window: browser } = globalThis; // other test files of this process use them
  t.after(() => Object.assign(globalThis, { document: page, window: browser, Notification: undefined }));
  const parts = {};
  let asked = 0;
  const sent = [];
  class Notification {
    static permission = "default";
    static requestPermission() { asked += 1; return Promise.resolve("granted"); }
    constructor(title, { tag }) { sent.push([title, tag]); }
  }
  Object.assign(globalThis, { Notification, window: { Notification, focus() {} }, document: {
    hidden: true, title: "", getElementById: (id) => (parts[id] ??= { classList: { add() {} } }),
  } });
  const end = awaitOutcome(() => {});
  const over = { ...facts("good"), id: "abc" };
  end(over);
  assert.deepEqual([asked, sent], [0, []]); // no request, no notification
  await parts.notify.onclick();
  assert.deepEqual([asked, sent], [1, []]);
  end(over);
  assert.deepEqual(sent, [["✓ torus", "abc"]]);
  document.hidden = false;
  end(over);
  assert.equal(sent.length, 1);
});

test("a fold with a verdict is not to be cancelled or awaited while its files are written", async (t) => {
  const { document: page, window: browser, EventSource, fetch } = globalThis;
  t.after(() => Object.assign(globalThis, { document: page, window: browser, Notification: undefined, EventSource, fetch }));
  const parts = {};
  const part = () => ({ classList: { contains: () => true }, dataset: {}, style: {}, firstElementChild: { style: {} } });
  Object.assign(globalThis, {
    window: { Notification: {} }, Notification: {}, document: { getElementById: (id) => (parts[id] ??= part()) },
    EventSource: class { addEventListener() {} },
    fetch: () => Promise.resolve(Response.json({ running: true, ...facts("good") })),
  });
  const progress = new Progress({ id: "abc" }, () => null);
  progress.token = "key";
  parts.name = { textContent: "torus" };
  const shown = async (stage) => {
    progress.show({ status: "running", stage, fraction: 0.5 });
    await new Promise((resolve) => setTimeout(resolve));
    return [parts.verdict.dataset.tone, parts.cancel.hidden, Boolean(parts.notify?.hidden)];
  };
  assert.deepEqual(await shown("certify"), ["busy", false, false]);
  assert.deepEqual(await shown("export"), ["good", true, true]);
  assert.equal(document.title, "✓ torus");
  assert.deepEqual(await shown("certify"), ["busy", false, true]); // it was interrupted, and is computed again
});
