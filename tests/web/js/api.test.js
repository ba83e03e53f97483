import assert from "node:assert/strict";
import { afterEach, beforeEach, test } from "node:test";
import {
  Refusal,
  ask,
  bring,
  broughtKeys,
  dropKey,
  forgetKeys,
  formOf,
  isKey,
  keepToken,
  keysHere,
  newKey,
  ownKey,
  remove,
  replaceOwn,
  tokenOf,
  useKey,
} from "../../../web/static/js/lib/api.js";
import { FoldList } from "../../../web/static/js/lib/owned_items.js";
import { span } from "../../../web/static/js/panels/owned_cards.js";

const OTHER = "o".repeat(32);

class Storage {
  setItem(name, value) {
    Object.defineProperty(this, name, {
      value: String(value),
      enumerable: true,
      configurable: true,
    });
  }
  getItem(name) {
    return this[name] ?? null;
  }
  removeItem(name) {
    delete this[name];
  }
}

const { fetch: usualFetch } = globalThis;
afterEach(() => {
  globalThis.fetch = usualFetch;
});
beforeEach(() => {
  globalThis.localStorage = new Storage();
});

test("a key is made when it is first needed, only once, and has 192 random bits", () => {
  assert.deepEqual(keysHere(), []);
  const key = ownKey();
  assert.match(key, /^[A-Za-z0-9_-]{32}$/);
  assert.equal(ownKey(), key);
  assert.deepEqual(keysHere(), [key]);
});

test("an entered key is used beside the browser's own, and can replace it", () => {
  const firstKey = ownKey();
  bring(OTHER);
  bring(OTHER);
  assert.deepEqual(keysHere(), [firstKey, OTHER]);
  assert.equal(ownKey(), firstKey);
  useKey(OTHER);
  assert.deepEqual([ownKey(), broughtKeys()], [OTHER, [firstKey]]);
  useKey(firstKey);
  assert.deepEqual([ownKey(), broughtKeys()], [firstKey, [OTHER]]);
  keepToken("theirs", OTHER);
  keepToken("mine", firstKey);
  dropKey(OTHER);
  assert.deepEqual([keysHere(), tokenOf("theirs"), tokenOf("mine")], [[firstKey], null, firstKey]);
  forgetKeys();
  assert.deepEqual(Object.keys(localStorage), []);
});

test("a new key replaces the browser's own key only", () => {
  const firstKey = ownKey();
  bring(OTHER);
  keepToken("mine", firstKey);
  keepToken("theirs", OTHER);
  const replacement = newKey();
  assert.notEqual(replacement, firstKey);
  bring(replacement);
  // Until it is known to hold the folds.
  assert.deepEqual(keysHere(), [firstKey, OTHER, replacement]);
  replaceOwn(replacement);
  assert.deepEqual(
    [keysHere(), tokenOf("mine"), tokenOf("theirs")],
    [[replacement, OTHER], replacement, OTHER],
  );
});

test("invalid stored data, or no storage at all, does no harm", () => {
  for (const text of [
    "",
    "{",
    "7",
    '{"a":1}',
    '[1, "short", "<script>alert(1)</script>aaaaaaaaaa"]',
  ]) {
    localStorage.setItem("foldback:keys", text);
    assert.deepEqual(broughtKeys(), [], text);
  }
  globalThis.localStorage = new Proxy(
    {},
    {
      get() {
        throw new Error("refused");
      },
    },
  );
  assert.deepEqual([ownKey(), keysHere(), bring(OTHER)], [null, [], false]);
});

test("a text that cannot be sent in a header is refused as a key", () => {
  for (const text of [
    "",
    "a".repeat(23),
    "a".repeat(201),
    `${OTHER}\n`,
    `${OTHER} x`,
    `${OTHER}\r\nX: y`,
    `<b>${OTHER}</b>`,
    "é".repeat(30),
  ])
    assert.ok(!isKey(text), text);
  assert.ok(isKey(OTHER) && isKey("AbC-_012345678901234567890"));
});

// Service with the folds of two keys: the time of each by its id.
const PAGES = {
  mine: [
    [
      ["m9", 9],
      ["m5", 5],
    ],
    [
      ["m4", 4],
      ["m1", 1],
    ],
  ],
  theirs: [
    [
      ["t8", 8],
      ["t7", 7],
    ],
    [["t6", 6]],
  ],
};
function service(refuse = () => false) {
  const requests = [];
  return {
    asked: requests,
    list: async (address, key) => {
      requests.push(address);
      if (refuse(requests.length)) throw new Error("away");
      const page = Number(new URL(address, "http://x").searchParams.get("page") ?? 0);
      const folds = PAGES[key][page].map(([id, at]) => ({
        id,
        created_at: new Date(at).toISOString(),
      }));
      return {
        folds,
        total: PAGES[key].flat().length,
        next: page + 1 < PAGES[key].length ? `/x?page=${page + 1}` : null,
      };
    },
  };
}

test("the folds of several keys are listed together, newest first", async () => {
  const { list: answer, asked: requests } = service();
  const list = new FoldList(["mine", "theirs"], answer);
  const ids = async (count) => (await list.more(count)).map(({ fold, key }) => `${fold.id} ${key}`);
  assert.deepEqual(await ids(3), ["m9 mine", "t8 theirs", "t7 theirs"]);
  // No more requests than needed.
  assert.deepEqual([list.total, list.done, requests.length], [7, false, 2]);
  assert.deepEqual(await ids(9), ["t6 theirs", "m5 mine", "m4 mine", "m1 mine"]);
  assert.ok(list.done);
  assert.deepEqual(await ids(9), []);
});

test("without a key the list is empty, and an error keeps what is already listed", async () => {
  assert.deepEqual(await new FoldList([]).more(5), []);
  const list = new FoldList(["mine"], service((n) => n === 2).list);
  assert.equal((await list.more(1)).length, 1);
  await assert.rejects(list.more(5), /away/);
  assert.deepEqual(
    (await list.more(5)).map(({ fold }) => fold.id),
    ["m5", "m4", "m1"],
  );
});

test("ages are given in one unit", () => {
  assert.deepEqual(
    [0, 90, 5399, 5400, 86400, 129600, 2592000].map((age) => span(age).replace("\u00a0", " ")),
    ["1 min", "2 min", "90 min", "2 h", "24 h", "2 days", "30 days"],
  );
});

// Service that answers each request in turn and lists the requests.
function answering(...answers) {
  const requests = [];
  globalThis.fetch = async (path, sent) => {
    requests.push([path, sent]);
    const [status, text] = answers.shift() ?? [];
    if (!status) throw new TypeError("no connection");
    return new Response(status === 204 ? null : text, { status });
  };
  return requests;
}

test("a request body is sent as JSON or as a form, and the key in one header", async () => {
  const requests = answering([200, '{"id":"a"}'], [204, ""], [201, "{}"]);
  assert.deepEqual(await ask("/api/folds/a"), { id: "a" });
  assert.deepEqual(
    await ask("/api/folds/a", { method: "PATCH", token: OTHER, body: { name: "Duck" } }),
    {},
  );
  await ask("/api/shapes/preview", { body: formOf({ seed: 3, full: false, start: null }) });
  assert.deepEqual(
    requests.map(([path, { method }]) => `${method} ${path}`),
    ["GET /api/folds/a", "PATCH /api/folds/a", "POST /api/shapes/preview"],
  );
  assert.deepEqual(
    requests.map(([, { headers }]) => headers),
    [{}, { Authorization: `Bearer ${OTHER}`, "Content-Type": "application/json" }, {}],
  );
  assert.deepEqual(
    [requests[0][1].body, requests[1][1].body, [...requests[2][1].body]],
    [
      null,
      '{"name":"Duck"}',
      [
        ["seed", "3"],
        ["full", "false"],
      ],
    ],
  );
});

test("a refusal has the words of the service, its status and its code", async () => {
  answering(
    [422, '{"code":"not-for-a-table","detail":"module 0 hangs","message":"module 1 hangs"}'],
    [502, "<html>"],
    [],
    [429, "null"],
  );
  const refusals = [];
  for (let k = 0; k < 4; k++) refusals.push(await ask("/x").catch((error) => error));
  assert.ok(refusals.every((error) => error instanceof Refusal));
  assert.deepEqual(
    refusals.map(({ message, status, code, final }) => [message, status, code, final]),
    [
      ["Module 1 hangs", 422, "not-for-a-table", true],
      ["The request failed: the server answered with status 502. Try again later.", 502, "", false],
      ["The server cannot be reached. Check the connection and try again.", 0, "", false],
      ["The request failed: the server answered with status 429. Try again later.", 429, "", false],
    ],
  );
});

test("a fold that is already gone counts as removed", async () => {
  answering([204, ""], [404, "{}"], [403, "{}"], [500, "{}"]);
  for (let k = 0; k < 3; k++) await remove("/x", OTHER);
  await assert.rejects(remove("/x", OTHER), /answered with status 500/);
});
