import assert from "node:assert/strict";
import { test } from "node:test";
import { radians } from "../../../web/static/js/lib/text.js";
import {
  colouringFor,
  colouringsOf,
  isOffered,
  ramped,
  usualColouring,
} from "../../../web/static/js/player/colours.js";
import {
  keptRows,
  packed,
  readValues,
  unpacked,
  valuesAt,
} from "../../../web/static/js/module_values/reading.js";
import { largestError } from "../../../web/static/js/player/player_state.js";
import { close, recorded, unpack, vectors } from "./vectors.js";

// Figures with the same values for every frame.
const figuresOf = (modules, joints) => ({
  row: () => ({
    position_error: new Float32Array(modules).fill(0.02),
    torque: new Float32Array(joints).fill(-0.3),
    clearance: Float32Array.from({ length: modules }, (_, i) => (i === 3 ? -0.01 : 0.2)),
  }),
  largest: (name) => ({ position_error: 0.034, torque: 1.7 })[name],
});

test("colours of a ramp are the same as in Python", async () => {
  const { bundle, shares, errors } = vectors.colours;
  const { header, arrays } = await unpack(bundle);
  const colours = ramped(
    Float64Array.from(shares, (v) => v ?? NaN),
    arrays.ramp_error,
    header.colours.unknown,
  );
  assert.deepEqual([...colours], errors);
});

test("every colouring has a scale in numbers", async () => {
  const { timeline } = await recorded();
  const snapshot = timeline.snapshot(timeline.last);
  const figures = figuresOf(timeline.chain.modules, timeline.joints);
  const scales = {};
  const coloursOf = {};
  for (const [key] of colouringsOf(false)) {
    const colouring = colouringFor(key, timeline, figures);
    coloursOf[key] = colouring.of(snapshot);
    assert.equal(coloursOf[key].length, 3 * timeline.chain.modules);
    scales[key] = colouring.legend().high;
    assert.match(
      colouring.legend().ramp,
      /^linear-gradient\(to right, (rgb\(\d+ \d+ \d+\)(, |\)$)){9}/,
    );
  }
  const { speed, error, ...otherScales } = scales;
  assert.deepEqual(otherScales, {
    "error-even": error,
    position: "0.034 pitch",
    torque: "1.7 N·m",
    clearance: "0.5 pitch",
    chain: "Module 16",
  });
  assert.match(speed, /^[\d.]+ m?rad\/s$/);
  const scale = timeline.errorScale;
  assert.equal(error, radians(scale));
  // Only errors and overlaps are red.
  const redness = (colours) =>
    Array.from(
      { length: colours.length / 3 },
      (_, i) => colours[3 * i] - Math.max(colours[3 * i + 1], colours[3 * i + 2]),
    );
  assert.ok(Math.max(...redness(coloursOf.error)) > 60);
  for (const key of ["error-even", "position", "torque", "speed", "chain"])
    assert.ok(Math.max(...redness(coloursOf[key])) < 60, key);
  assert.deepEqual([...coloursOf.clearance.subarray(9, 12)], timeline.bundle.header.colours.error);
});

test("a moment without any value shows the positions in the chain, and says why", async () => {
  const { timeline } = await recorded();
  const nothing = { row: () => null, largest: () => 0 };
  const [first, last] = [timeline.snapshot(0), timeline.snapshot(timeline.last)];
  const chain = colouringFor("chain", timeline, nothing);
  for (const key of ["error", "position", "torque", "clearance"]) {
    const colouring = colouringFor(key, timeline, nothing);
    assert.deepEqual(colouring.of(first), chain.of(first), key);
    const { none, missing, ...legend } = colouring.legend();
    const { low, high, ramp } = chain.legend();
    assert.deepEqual([missing, legend], ["all", { low, high, ramp }], key);
    assert.match(none, key === "error" ? /^Joint error exists only while folding$/ : /./);
  }
  // While the chain folds, the errors are known, and the scale ends at their peak.
  const error = colouringFor("error", timeline, nothing);
  assert.notDeepEqual(error.of(last), chain.of(last));
  assert.deepEqual([error.missing, error.legend().none], ["none", null]);
  const errors = Array.from({ length: timeline.last + 1 }, (_, k) => largestError(timeline.row(k)));
  close([timeline.errorScale], [Math.max(...errors)], { rtol: 0.01 }); // as precise as they travel
  assert.equal(error.legend().high, radians(timeline.errorScale));
});

test("modules without a value are grey if others have one", async () => {
  const { timeline } = await recorded();
  const modules = timeline.chain.modules;
  const values = Float32Array.from({ length: modules }, (_, i) => (i ? 1 : NaN));
  const figures = { row: () => ({ clearance: values }), largest: () => 1 };
  const colouring = colouringFor("clearance", timeline, figures);
  const colours = colouring.of(timeline.snapshot(0));
  assert.deepEqual([...colours.subarray(0, 3)], timeline.bundle.header.colours.unknown);
  assert.equal(colouring.legend().none, "no data for this frame");
});

test("only colourings with values of single modules are offered", async () => {
  const { timeline } = await recorded();
  const { timeline: peeled } = await recorded(vectors.peeled);
  const offered = (of, ...names) =>
    colouringsOf(false)
      .map(([key]) => key)
      .filter((key) => isOffered(key, of, { offers: (name) => names.includes(name) }));
  const always = ["error", "error-even", "speed", "chain"];
  assert.deepEqual(offered(timeline), always); // a downloaded page has no values of single modules
  assert.deepEqual(offered(timeline, "clearance"), [
    "error",
    "error-even",
    "speed",
    "clearance",
    "chain",
  ]);
  assert.deepEqual(offered(peeled, "clearance", "torque", "position_error"), [
    "error",
    "error-even",
    "position",
    "speed",
    "chain",
  ]);
});

// Numbers of a visitor.
const expected = { modules: 4, frames: 3 };
const read = (text, name = "heat.csv") => readValues(text, name, expected);
const list = ({ values }) => Array.from(values, (value) => (Number.isNaN(value) ? null : value));

const READ = [
  ["1\n2\n3\n4", [1, 2, 3, 4], "heat", ""],
  ["\uFEFFTemperature (°C)\r\n1,5\r\n2\r\n\r\n4e0\r\n", [1.5, 2, null, 4], "Temperature", "°C"],
  ["load [mN];\n1,5;\n2;\nNaN;\n4;\n", [1.5, 2, null, 4], "load", "mN"],
  ["module,heat\n4,40\n1,10\n2,20\n", [10, 20, null, 40], "heat", ""],
  ["0\t10\n3\t-40\n", [10, null, null, -40], "heat", ""],
  ["# stress\n1.0e0 2.0e0 nan 4.0e0", [1, 2, null, 4], "stress", ""],
  ["1;2;3;4\n5;6;7;8\n9;10;11;", [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, null], "heat", ""],
  [
    ",0,1,2,3\n0,1,2,3,4\n1,5,6,7,8\n2,9,10,11,12\n",
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    "heat",
    "",
  ],
  [
    "frame,m1,m2,m3,m4\n1,1,2,3,4\n2,5,6,7,8\n3,9,10,11,12",
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    "heat",
    "",
  ],
  ["1,5,9\n2,6,10\n3,7,11\n4,8,12", [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], "heat", ""],
  ["[1, NaN, null, 4]", [1, null, null, 4], "heat", ""],
  [
    '{"name": "Heat", "unit": "K", "values": [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]]}',
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    "Heat",
    "K",
  ],
];

test("numbers are read from files in many formats", () => {
  for (const [text, values, name, unit] of READ) {
    const parsed = read(text);
    assert.deepEqual([list(parsed), parsed.name, parsed.unit], [values, name, unit], text);
    const finite = values.filter((value) => value !== null);
    assert.deepEqual([parsed.low, parsed.high], [Math.min(...finite), Math.max(...finite)], text);
  }
});

const REFUSED = [
  [
    "1\n2\n3",
    /This file has 3 rows with 1 number each. This fold needs 4 numbers, one for each module, or 3 rows of 4 numbers,/,
  ],
  ["1,2,3,4\n5,6,7", /Line 2: this line has 3 values, but the lines before it have 4/],
  ["1\n2\nthree\n4", /Line 3: "three" is not a number/],
  ["1,2,3\nfoo", /^Error: Line 2: "foo" is not a number/],
  ["heat\nhot\ncold", /^Error: Line 1: "heat" is not a number/],
  ["1,1\n9,2", /Line 2: there is no module 9. Module numbers go from 1 to 4/],
  ["1,1\n1,2", /Line 2: module 1 appears twice/],
  ["\n\n", /This fold needs 4 numbers/],
  ["nan\nnan\nnan\nnan", /contains no numbers/],
  ['{"a": 1}', /has no list of numbers/],
  ["[1, 2", /The file is not valid JSON/],
  ['[1, 2, 3, {"a": 1}]', /Value 4: {"a":1} is not a number/],
  [
    '{"format": "foldback-values/1", "rows": 1, "low": 0, "high": 1, "data": "AAA="}',
    /the values of another fold/,
  ],
];

test("unsuitable numbers are refused with a message", () => {
  for (const [text, words] of REFUSED) assert.throws(() => read(text), words, text);
});

test("stored numbers are restored within one level of the scale", () => {
  const ownValues = read("1;2;3;4\n5;6;7;8\n9;10;11;");
  const restored = unpacked(packed(ownValues), 4);
  assert.deepEqual([restored.name, restored.rows, restored.low, restored.high], ["heat", 3, 1, 11]);
  ownValues.values.forEach((value, i) =>
    assert.ok(
      Number.isNaN(value)
        ? Number.isNaN(restored.values[i])
        : Math.abs(value - restored.values[i]) <= 10 / 254,
    ),
  );
  assert.deepEqual(list(read(JSON.stringify(packed(ownValues)))), list(restored));
  // Rows beyond the limit are dropped evenly.
  const long = readValues(
    JSON.stringify(Array.from({ length: 90 }, (_, k) => Array.from({ length: 1000 }, () => k))),
    "a.json",
    { modules: 1000, frames: 90 },
  );
  const short = unpacked(packed(long), 1000);
  assert.deepEqual(
    [keptRows(long), short.rows, short.values[0], short.values.at(-1)],
    [45, 45, 0, 89],
  );
});

test("values between rows are interpolated", () => {
  const ownValues = read("1;2;3;4\n5;6;7;8\n9;10;11;");
  assert.deepEqual(Array.from(valuesAt(ownValues, 0)), [1, 2, 3, 4]);
  assert.deepEqual(Array.from(valuesAt(ownValues, 0.25)), [3, 4, 5, 6]);
  assert.deepEqual(Array.from(valuesAt(ownValues, 0.9)).map(Math.round), [8, 9, 10, NaN]);
  assert.deepEqual(Array.from(valuesAt(ownValues, 1)), [9, 10, 11, NaN]);
});

test("modules with colours of their own show them in turn", async () => {
  const { timeline } = await recorded();
  const { header } = timeline.bundle;
  assert.equal(usualColouring("chain", header), "chain");
  assert.equal(colouringFor("module", timeline, null).key, "chain");
  const usual = colouringFor("chain", timeline, null).of(timeline.snapshot(0));
  assert.deepEqual(colouringFor("module", timeline, null).of(timeline.snapshot(0)), usual);
  const own = [
    [10, 20, 30],
    [200, 100, 0],
  ];
  const bundle = { ...timeline.bundle, header: { ...header, own_colours: own } };
  const painted = Object.assign(Object.create(timeline), { bundle });
  assert.equal(usualColouring("chain", bundle.header), "module");
  assert.equal(usualColouring("error", bundle.header), "error");
  assert.equal(colouringsOf(false, bundle.header)[0][0], "module");
  const colouring = colouringFor("module", painted, null);
  assert.deepEqual([...colouring.of().subarray(0, 9)], [...own[0], ...own[1], ...own[0]]);
  assert.match(colouring.legend().ramp, /rgb\(10 20 30\) 0.00% 50.00%, rgb\(200 100 0\)/);
});
