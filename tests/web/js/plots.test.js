import assert from "node:assert/strict";
import { test } from "node:test";
import { csv } from "../../../web/static/js/panels/plots.js";

test("a plot as text has every frame, from 1 as on the page, and nothing where nothing is known", () => {
  assert.equal(csv("min_clearance", [0.25, NaN, -0.5]), "frame,min_clearance\n1,0.25\n2,\n3,-0.5");
});
