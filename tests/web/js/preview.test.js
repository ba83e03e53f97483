import assert from "node:assert/strict";
import { test } from "node:test";
import {
  Preview,
  figuresOf,
  isLossy,
  nearby,
  notesOf,
  oddWords,
  offerOf,
  reachOf,
  troubleOf,
  verdictOf,
} from "../../../web/static/js/panels/preview_state.js";

const CHOICES = {
  module: ["cube", "tetrahedron"],
  method: ["auto", "blocks", "exact", "snake"],
  ends: ["any", "surface"],
  world: ["floating", "table"],
};
const FACTS = {
  id: "abc",
  most_modules: 12_000,
  table_modules: 64,
  path_modules: ["cube"],
  next_scripts: [],
  origin: {},
  options: {},
};
const opened = (query = "") => new Preview(FACTS, CHOICES, new URLSearchParams(query));
const report = (fields = {}) => ({
  kind: "mesh",
  key: "k",
  name: "brick",
  module: "cube",
  module_words: { singular: "cube", plural: "cubes" },
  modules: 64,
  asked: null,
  below: null,
  above: null,
  iou: null,
  has_path: true,
  as_voxels: false,
  not_started: "",
  candidates: 3,
  expected_s: 5,
  expected_as_published_s: 300,
  expected_preferred_s: 50,
  knot: null,
  feasibility: null,
  notes: [],
  added: [],
  cells: [],
  ...fields,
});

test("the address holds changed options, and invalid ones are ignored", () => {
  const query = "?module=tetrahedron&modules=64&method=exact&ends=surface&start=1%2C-2%2C3&seed=7";
  assert.equal(
    opened(query).query,
    query.replace("&start=1%2C-2%2C3", "").replace("&seed", "&start=1%2C-2%2C3&seed"),
  );
  assert.equal(
    opened("?module=sphere&modules=x&method=__proto__&ends=&start=1,2&seed=a&world=sea").query,
    "",
  );
  assert.equal(opened("?as_voxels=true&repair=true").query, "?repair=true&as_voxels=true");
});

test("a number of modules stays within its bounds, which are shown when they are reached", () => {
  const preview = opened("?modules=15000");
  assert.deepEqual(
    [preview.options.modules, preview.bound],
    [12_000, "At most 12\u2009000 modules"],
  );
  for (const [modules, count, words] of [
    [3, 8, "At least 8 modules"],
    [NaN, 8, ""],
    [99.6, 100, ""],
  ]) {
    preview.change({ modules });
    assert.deepEqual([preview.options.modules, preview.bound], [count, words]);
  }
  for (const place of [0, 500, 1000])
    assert.ok(Math.abs(preview.placeOf(preview.modulesAt(place)) - place) <= 2);
  assert.deepEqual([preview.modulesAt(0), preview.modulesAt(1000)], [8, 12_000]);
});

test("options of a picture are part of the address, and its modules can be chosen", () => {
  const preview = opened("?threshold=40&inside_out=true&thickness=2");
  assert.equal(preview.query, "?threshold=40&inside_out=true&thickness=2");
  assert.equal(preview.count, null);
  preview.take(report({ kind: "picture", modules: 800 }));
  assert.equal(preview.count, 800);
  preview.change({ threshold: null, inside_out: false, thickness: null });
  assert.equal(preview.query, "");
});

test("the starting cell is dropped when cells change, and kept when only their order does", () => {
  for (const [change, start] of [
    [{ ends: "surface" }, "1,2,3"],
    [{ as_voxels: true }, "1,2,3"],
    [{ seed: 3 }, null],
    [{ method: "blocks" }, null],
    [{ modules: 24 }, null],
    [{ start: "4,5,6" }, "4,5,6"],
  ]) {
    const preview = opened("?start=1,2,3");
    preview.change(change);
    assert.equal(preview.options.start, start, JSON.stringify(change));
  }
});

test("a fold on a table has cubes, the default preset and no preference", () => {
  const preview = opened("?module=tetrahedron&ends=surface&method=snake&start=1,2,3");
  preview.plan("default", "time");
  assert.equal(preview.prefer, "time");
  preview.change({ world: "table" });
  assert.equal(preview.query, "?world=table");
  assert.deepEqual(
    [preview.preset, preview.prefer, preview.choosing, preview.settable],
    ["default", "computing", false, "table"],
  );
  preview.change({ method: "blocks", repair: true });
  assert.equal(preview.options.method, "blocks");
  preview.change({ world: "floating" }); // repairs and blocks are chosen for one world
  assert.equal(preview.query, "");
  const settable = ["default", "paper", "direct"].map((preset) => {
    preview.plan(preset, "computing");
    return preview.settable;
  });
  assert.deepEqual(settable, ["robot", "paper", undefined]);
});

test("the expected time depends on the preset and the preference", () => {
  const preview = opened();
  assert.equal(preview.expected, "–");
  preview.take(report());
  const expected = (preset, prefer) => {
    preview.plan(preset, prefer);
    return preview.expected;
  };
  assert.deepEqual(
    [expected("default", "computing"), expected("default", "torque"), expected("paper", "torque")],
    ["about 5 s", "about 50 s", "about 5 min"],
  );
  preview.refuse();
  assert.equal(preview.expected, "–");
});

test("the module that was clicked can become the first, which can be undone", () => {
  const preview = opened();
  assert.equal(preview.start, null);
  preview.take(report());
  preview.picked = { module: 4, cell: [1, 2, 3] };
  assert.deepEqual(preview.start, {
    text: "Module 5 of 64",
    button: "Start here",
    change: { start: "1,2,3" },
  });
  preview.change({ start: "1,2,3" });
  preview.take(report());
  assert.deepEqual(preview.start, {
    text: "The chain starts at cell (1, 2, 3)",
    button: "Undo",
    change: { start: null },
  });
  preview.picked = { module: 0, cell: [1, 2, 3] };
  assert.equal(preview.start.button, "");
  preview.take(report({ not_started: "no path starts there" }));
  assert.equal(preview.options.start, null);
});

test("a chain of a file folds on a table only if it can follow a path", () => {
  const preview = opened();
  assert.equal(preview.mayRest, true);
  preview.take(report({ kind: "chain", follows_paths: false }));
  assert.equal(preview.mayRest, false);
  preview.take(report({ kind: "chain", follows_paths: true }));
  assert.equal(preview.mayRest, true);
});

test("a report is put into words", () => {
  assert.equal(verdictOf(report({ iou: 0.987 })), "64 cubes · 99\u00a0% like your file");
  assert.equal(
    verdictOf(report({ iou: 0.5, final: false })),
    "64 cubes · 50\u00a0% like your file, improving…",
  );
  assert.equal(verdictOf(report({ has_path: false })), "64 cells, no path yet");
  const prism = { module_words: { singular: "prism", plural: "prisms" } };
  assert.equal(verdictOf(report({ ...prism, modules: 24 })), "24 prisms");
  assert.equal(verdictOf(report({ ...prism, modules: 1 })), "1 prism");
  assert.deepEqual(
    figuresOf(
      report({
        knot: { verdict: "knotted", determinant: 3 },
        iou: 0.5,
        likeness: { iou: 0.5, missing: 0.004, added: 0.498 },
      }),
    ),
    {
      iou: "50\u00a0%",
      likeness:
        "Less than 1\u00a0% of your file is missing, 50\u00a0% of the modules’ volume is outside of it.",
      candidates: "3",
      knotted: true,
      knot: "Yes",
      knotHint:
        "The knot is undone while the chain unfolds, which takes longer. The chain’s determinant, a test number for knots, is 3. Without a knot, it would be 1.",
    },
  );
  assert.deepEqual(
    [
      figuresOf(report()).knot,
      figuresOf(report({ knot: { verdict: "unknot", determinant: 1 } })).knot,
    ],
    ["–", "No"],
  );
  assert.deepEqual(nearby(opened(), report({ asked: 65, below: 60, above: 64 })), {
    counts: [60],
    text: "64 is the closest possible number to 65",
  });
  assert.deepEqual(nearby(opened(), report({ below: 60, above: 72 })), {
    counts: [60, 72],
    text: "Also possible",
  });
  assert.deepEqual(nearby(opened("?world=table"), report({ below: 60 })), { counts: [], text: "" });
  const long = opened("?world=table");
  long.take(report({ modules: 65 }));
  assert.match(long.warning, /more than 64 modules usually get stuck/);
});

test("the reason why there is no path comes with a remedy", () => {
  const repair = {
    add: [[0, 0, 0]],
    drop: [],
    detail: "Add one cell.",
    doubled: true,
    modules: 72,
  };
  const problem = (code) => ({ code, detail: "why", cells: [[0, 0, 0]] });
  const bad = report({
    has_path: false,
    feasibility: {
      feasible: false,
      problems: [problem("parity")],
      repairs: [{ ...repair, add: [] }, repair],
    },
  });
  const { title, details, ways } = troubleOf(opened(), bad);
  assert.deepEqual([title, details], ["No path runs through all of these cells", ["why"]]);
  assert.deepEqual(ways, [
    { text: "Repair: add one cell", primary: true, change: { repair: true, modules: 72 } },
    { text: "Use 2×2×2 modules for each cell", change: { method: "blocks" } },
  ]);
  assert.equal(oddWords(bad), "cells of the more common colour in a chessboard pattern");
  assert.equal(oddWords(report()), "");
  const apart = report({
    has_path: false,
    feasibility: { feasible: false, problems: [problem("disconnected")], repairs: [] },
  });
  assert.deepEqual(troubleOf(opened(), apart).ways, []);
  assert.equal(troubleOf(opened("?module=tetrahedron"), bad).ways.length, 1);
  const table = troubleOf(opened("?world=table&as_voxels=true"), bad);
  assert.deepEqual(
    [table.title, table.ways],
    [
      "With 64 modules, this shape can’t be folded on a table",
      [{ text: "Fold in zero gravity", change: { as_voxels: true, world: "floating" } }],
    ],
  );
  const offer = {
    kind: "repair",
    modules: 72,
    change: { modules: null, method: null, repair: true },
    added: [
      [0, 0, 0],
      [0, 0, 1],
    ],
  };
  assert.deepEqual(offerOf(offer, 1), {
    text: "Add 2 cells: 72 modules",
    primary: false,
    change: { repair: true },
  });
});

test("a report says what is lost, and about how many modules are how much like the file", () => {
  assert.deepEqual(
    [{}, { unused_bodies: [0.42] }, { keeps_parts: false }].map((fields) =>
      isLossy(report(fields)),
    ),
    [false, true, true],
  );
  const reach = [
    { likeness: 0.6, modules: 220 },
    { likeness: 0.75, modules: 2400 },
    { likeness: 0.9, modules: null },
    { likeness: 0.95, modules: null },
  ];
  const { ways, limit } = reachOf(opened(), report({ reach }));
  assert.deepEqual(ways, [
    {
      text: "60\u00a0%: 220",
      label: "About 220 modules are 60\u00a0% like your file",
      change: { modules: 220 },
    },
    {
      text: "75\u00a0%: 2\u2009400",
      label: "About 2\u2009400 modules are 75\u00a0% like your file",
      change: { modules: 2400 },
    },
  ]);
  assert.equal(
    limit,
    "Even 12\u2009000 modules are less than 90\u00a0% like your file. Thicker parts would help more.",
  );
  assert.deepEqual(reachOf(opened(), report({})), { ways: [], limit: "" });
});

test("each note is shown in one place", () => {
  const notes = [
    "The cells were read as a shape, not as a path, because some cells that follow each other are not neighbours.",
    "the rest",
  ];
  const repaired = "added the cell (1, 0, 2).";
  assert.deepEqual(notesOf(opened("?repair=true"), report({ notes, repaired, as_voxels: true })), {
    repaired: `Repaired: ${repaired}`,
    unordered: notes[0],
    others: ["The rest"],
  });
  const ordered = report({ notes, repaired, as_voxels: true });
  assert.deepEqual(notesOf(opened("?as_voxels=true"), ordered), {
    repaired: "", // as it was not requested
    unordered: "",
    others: [notes[0], "The rest"],
  });
  assert.equal(
    notesOf(opened("?world=table&method=blocks"), report()).repaired,
    "Each cell became 2×2×2 modules.",
  );
});
