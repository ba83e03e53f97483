import assert from "node:assert/strict";
import { test } from "node:test";
import { OverallProgress, queueWords } from "../../../web/static/js/panels/overall_progress.js";
import { Progress } from "../../../web/static/js/panels/progress.js";
import { outcome } from "../../../web/static/js/panels/plan_check.js";
import {
  announcementOf,
  awaitOutcome,
  headingOf,
  titleOf,
} from "../../../web/static/js/panels/outcome.js";

const said = {
  limits: "",
  standard: true,
  module: "cube",
  exempt: 7,
  start: "straight",
  end: "folded: 3 of 12 hinges are bent, by up to 90.0 degrees",
};
const proved = {
  is: "proved",
  plan: { frames: 9, modules: 8, size: 0.95, claim: 0.03125 },
  touch: null,
  tightest: null,
  joint: 0,
  size: 0.95,
  seconds: 1,
};

test("a checked plan is described by its modules, their size, the start and the end", () => {
  assert.equal(
    outcome("claim", { ...proved, said }),
    "This browser checked 8 modules without our server. Each module (cube) fills 95.0 % of the spacing. The motion begins straight. It ends folded: 3 of 12 hinges are bent, by up to 90.0 degrees. Modules that share no joint stay at least 3.1 % of the spacing apart during the whole motion. The check took 1 s.",
  );
  assert.match(
    outcome("claim", { ...proved, said: { ...said, exempt: 0 } }),
    / All modules stay at least 3\.1 % of the spacing apart/,
  );
  assert.match(
    outcome("claim", { ...proved, said: { ...said, limits: "nothing folds" } }),
    /^Proved, but nothing folds\. This browser/,
  );
  assert.match(
    outcome("claim", {
      ...proved,
      said: { ...said, standard: false, module: '"brick" as the plan describes it' },
    }),
    /Each module, at 95\.0 % of its full size, is "brick" as the plan describes it\..*at least 3\.1 % of the spacing apart/,
  );
});

const facts = (tone) => ({ name: "torus", verdict: { tone, text: "" } });

test("the title of a running fold shows its progress", () => {
  const advance = new OverallProgress();
  const title = (now) => {
    advance.note(now);
    return titleOf(now.status, "torus", advance);
  };
  assert.equal(title({ status: "running", stage: "read" }), "Preparing 0 % · torus · foldback");
  assert.equal(
    title({ status: "running", stage: "explode", fraction: 0.429 }),
    "Unfolding 42 % · torus · foldback",
  );
  assert.equal(
    title({ status: "running", stage: "certify", message: "verified; computing the margins" }),
    "✓ Verified, computing the margins … · torus · foldback",
  );
  assert.equal(
    title({ status: "running", stage: "export", fraction: 0 }),
    "Writing the files … · torus · foldback",
  );
  assert.equal(
    title({ status: "queued", stage: "read", fraction: 0.4 }),
    "Waiting · torus · foldback",
  );
});

test("the title has a mark when there is a verdict", () => {
  assert.deepEqual(
    ["good", "bad", "soft"].map((tone) => headingOf(facts(tone))),
    ["✓ torus", "✕ torus", "torus"],
  );
});

test("only a verified fold is announced", () => {
  assert.deepEqual(
    ["good", "bad"].map((tone) => announcementOf(facts(tone))),
    ["✓ torus: fold verified", null],
  );
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
  assert.deepEqual(
    after([
      ["play_back", 0.3, 30],
      ["play_back", 0.2, 26],
      ["play_back", 0.4, 36],
    ]),
    [
      [0.3, 30, 1],
      [0.3, 30, 1],
      [0.4, 36, 1],
    ],
  );
});

test("an earlier stage begins another attempt", () => {
  assert.deepEqual(
    after([
      ["explode", 0.9, 0],
      ["play_back", 0.1, 5],
      ["explode", 0.06, 0],
    ]).at(-1),
    [0.06, 0, 2],
  );
});

test("a fold that waits gives its reason", () => {
  assert.deepEqual(
    [0, 1, 2, 4].map((place) => queueWords(place)),
    [
      "In the queue",
      "Next in line",
      "In the queue, behind 1 other fold",
      "In the queue, behind 3 other folds",
    ],
  );
  assert.deepEqual(
    [1, 3].map((place) => queueWords(place, 1)),
    ["Next in line, after the running fold", "In the queue, behind 3 other folds"],
  );
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
  const names = [
    ["explode", "smoothing"],
    ["explode", "done"],
    ["play_back", ""],
    ["explode", ""],
  ].map(([stage, message]) => {
    advance.note({ stage, message });
    return advance.name();
  });
  assert.equal(names[0], "Smoothing");
  assert.equal(names[1], "Smoothing");
  assert.notEqual(names[2], "Smoothing");
  assert.equal(names[3], "Unfolding");
});

test("permission to notify is asked on a click only, and a hidden tab notifies once", async (t) => {
  // Other test files of this process use them.
  const { document: page, window: browser } = globalThis;
  t.after(() =>
    Object.assign(globalThis, { document: page, window: browser, Notification: undefined }),
  );
  const parts = {};
  let requests = 0;
  const sent = [];
  class Notification {
    static permission = "default";
    static requestPermission() {
      requests += 1;
      return Promise.resolve("granted");
    }
    constructor(title, { tag }) {
      sent.push([title, tag]);
    }
  }
  Object.assign(globalThis, {
    Notification,
    window: { Notification, focus() {} },
    document: {
      hidden: true,
      title: "",
      getElementById: (id) => (parts[id] ??= { classList: { add() {} } }),
    },
  });
  const end = awaitOutcome(() => {});
  const over = { ...facts("good"), id: "abc" };
  end(over);
  assert.deepEqual([requests, sent], [0, []]); // no request, no notification
  await parts.notify.onclick();
  assert.deepEqual([requests, sent], [1, []]);
  end(over);
  assert.deepEqual(sent, [["✓ torus", "abc"]]);
  document.hidden = false;
  end(over);
  assert.equal(sent.length, 1);
});

test("a fold has no verdict, and can be cancelled, while its files are written", (t) => {
  const { document: page, window: browser, EventSource } = globalThis;
  t.after(() =>
    Object.assign(globalThis, {
      document: page,
      window: browser,
      Notification: undefined,
      EventSource,
    }),
  );
  const parts = {};
  const part = () => ({
    classList: {
      contains: () => true,
      toggle(name, on) {
        this[name] = on;
      },
    },
    dataset: {},
    style: {},
    firstElementChild: { style: {} },
  });
  Object.assign(globalThis, {
    window: { Notification: {} },
    Notification: {},
    document: { getElementById: (id) => (parts[id] ??= part()) },
    EventSource: class {
      addEventListener() {}
    },
  });
  const progress = new Progress({ id: "abc" }, () => null);
  progress.token = "key";
  parts.name = { textContent: "torus" };
  const partsAt = (stage) => {
    progress.show({ status: "running", stage, fraction: 0.5, remaining_s: 0 });
    return [
      parts.verdict.dataset.tone,
      parts.verdict.textContent,
      parts.cancel.hidden,
      parts.progress.classList.unmeasured,
    ];
  };
  assert.deepEqual(partsAt("certify"), [
    "busy",
    "Checking clearance 50 % · takes longer than usual",
    false,
    false,
  ]);
  assert.deepEqual(partsAt("export"), ["busy", "Writing the files …", false, true]);
  assert.equal(document.title, "Writing the files … · torus · foldback");
});
