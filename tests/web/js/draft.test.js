import assert from "node:assert/strict";
import { test } from "node:test";
import { Draft } from "../../../web/static/js/editor/draft.js";

/** @param {string | null} text */
function storage(text = null) {
  return () => ({ getItem: () => text, setItem: (_, value) => { text = value; } });
}
const seen = ({ how, name }) => [how, name];

test("draft_after_a_reload_keeps_the_path_and_its_name", () => {
  const stored = storage();
  new Draft(stored).note({ how: "path", name: "Duck" });
  assert.deepEqual(seen(new Draft(stored)), ["path", "Duck"]);
});

test("draft_with_nothing_or_nonsense_stored_is_empty", () => {
  for (const text of [null, "{", "null", '{"how":"all","name":7}']) assert.deepEqual(seen(new Draft(storage(text))), ["no", ""]);
});

test("draft_without_storage_still_works", () => {
  const draft = new Draft(() => { throw new Error("no storage"); });
  draft.note({ how: "yes" });
  assert.equal(draft.how, "yes");
});

test("clear_drops_a_given_name_and_keeps_a_typed_one", () => {
  const stored = storage();
  new Draft(stored).give("Letter A");
  const draft = new Draft(stored);
  draft.clear();
  assert.equal(draft.name, "");
  draft.give("Letter B");
  draft.note({ name: "Slab" });
  draft.clear();
  assert.equal(draft.name, "Slab");
});
