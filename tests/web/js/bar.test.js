import assert from "node:assert/strict";
import { test } from "node:test";
import { frameIn } from "../../../web/static/js/player/bar.js";

test("a frame is typed as it is told: from 1, with or without its space; all else is none", () => {
  assert.deepEqual(["1", " 240 ", "1 085", "1\u2009085"].map((text) => frameIn(text, 1085)), [0, 239, 1084, 1084]);
  for (const text of ["", "0", "1086", "-3", "2.5", "1e2", "12 s", "99999999999"]) assert.equal(frameIn(text, 1085), null, text);
});
