import assert from "node:assert/strict";
import { test } from "node:test";

import { movieOptions } from "../../../web/static/js/panels/downloads.js";

test("The options of a movie have the types that the service takes", () => {
  const fields = { format: "gif", size: "640x360", seconds: "6.5", turn_deg: "-30", tour: "false" };
  const [format, seconds, turn, tour] = ["gif", 6.5, -30, false];
  const options = { format, seconds, turn_deg: turn, tour, width: 640, height: 360 };
  assert.deepEqual(movieOptions(fields), options);
});
