// Requests to the service, and the access keys of this browser: its own, and those added from other
// browsers. A key is an owner token, which gives access to everything that was made with it. Keys
// are sent only in the Authorization header.
import { UNREACHABLE, at, sentence, store, stored } from "./text.js";

const OWN = "foldback:token";
const BROUGHT = "foldback:keys";
const OF_FOLD = "foldback:owner:";
const KEY = /^[A-Za-z0-9_.~+/=-]{24,200}$/;
const BYTES = 24;
export const MOST_KEYS = 8;
const GONE = new Set([403, 404]);
const BUSY = 429;

// A refused request, with a message for the visitor.
export class Refusal extends Error {
  /**
   * @param {string} words
   * @param {number} status 0 if the server cannot be reached
   * @param {string} code error code of the API; empty if there is none
   * @param {Record<string, any>} values that the words name
   */
  constructor(words, status = 0, code = "", values = {}) {
    super(words);
    this.status = status;
    this.code = code;
    this.values = values;
  }

  // True if a retry would be refused as well.
  get final() {
    return this.status >= 400 && this.status < 500 && this.status !== BUSY;
  }

  // True if the requested item does not exist, or not for this key.
  get gone() {
    return GONE.has(this.status);
  }
}

// Return the message of the server as a sentence.
/**
 * @param {Refused} problem
 * @param {number} status
 */
export const refusalWords = ({ message, detail }, status) =>
  sentence(
    message ??
      detail ??
      `The request failed: the server answered with status ` +
        `${status}.${status === BUSY || status >= 500 ? " Try again later." : ""}`,
  );

// Return the JSON of an answer; other content becomes {}, because proxies send their own pages.
/**
 * @param {number} status
 * @param {string} text
 * @returns {any}
 * @throws {Refusal} for a status other than 2xx
 */
export function contentOf(status, text) {
  let content = {};
  try {
    content = JSON.parse(text) ?? {};
  } catch {
    /* no JSON */
  }
  if (status < 200 || status > 299) {
    const { code, values } = /** @type {Refused} */ (content);
    throw new Refusal(refusalWords(content, status), status, code, values);
  }
  return content;
}

// Return a form with the fields that are not null.
/** @param {Form} fields */
export function formOf(fields) {
  const form = new FormData();
  for (const [key, value] of Object.entries(fields))
    if (value !== null) form.set(key, value instanceof Blob ? value : String(value));
  return form;
}

// Send a request to the service. The default method with a body
// is POST; a form is sent unchanged, other values as JSON.
/**
 * @template Answer
 * @param {string} path
 * @param {{ method?: string, body?: FormData | object | null, token?: string | null,
 *   signal?: AbortSignal }} request
 * @returns {Promise<Answer>}
 * @throws {Refusal}
 */
export async function ask(path, { method, body = null, token = null, signal } = {}) {
  const plain = body !== null && !(body instanceof FormData);
  const sent = {
    method: method ?? (body ? "POST" : "GET"),
    signal,
    body: plain ? JSON.stringify(body) : body,
    headers: { ...proof(token), ...(plain && { "Content-Type": "application/json" }) },
  };
  const { status, text } = await fetch(at(path), sent)
    .then(async (answer) => ({ status: answer.status, text: await answer.text() }))
    .catch(() => {
      throw new Refusal(UNREACHABLE);
    });
  return contentOf(status, text);
}

// Poll until `over` returns true for an answer, or until the signal aborts the polling.
/**
 * @template Answer
 * @param {string} path
 * @param {number} pauseMs
 * @param {(answer: Answer) => boolean} over
 * @param {AbortSignal} [signal]
 * @throws {Refusal} if the item no longer exists
 */
export async function askUntil(path, pauseMs, over, signal) {
  let wake = () => {};
  const pause = () =>
    /** @type {Promise<void>} */ (
      new Promise((resolve) => {
        wake = resolve;
        setTimeout(resolve, pauseMs);
      })
    );
  signal?.addEventListener("abort", () => wake());
  for (;;) {
    const answer = await ask(path, { signal }).catch((error) => error);
    if (signal?.aborted) return;
    if (!(answer instanceof Refusal)) {
      if (over(answer)) return;
    } else if (answer.gone) throw answer;
    await pause();
  }
}

// Delete an item; ignore one that no longer exists.
/**
 * @param {string} path
 * @param {string | null} token
 */
export async function remove(path, token) {
  try {
    await ask(path, { method: "DELETE", token });
  } catch (error) {
    if (!(error instanceof Refusal && error.gone)) throw error;
  }
}

/** @param {string} text */
export const isKey = (text) => KEY.test(text);

// Return the browser's own key, created on first use; null if
// storage is refused. The same key and file give the same fold.
export function ownKey() {
  const existing = stored(OWN);
  if (existing) return existing;
  const created = newKey();
  return store(OWN, created) ? created : null;
}

export const newKey = () =>
  btoa(String.fromCharCode(...crypto.getRandomValues(new Uint8Array(BYTES))))
    .replaceAll("+", "-")
    .replaceAll("/", "_");

// Replace the browser's own key, and its tokens of
// folds, by a new key that was stored as an added one.
/** @param {string} key */
export function replaceOwn(key) {
  const old = stored(OWN);
  for (const [id, token] of ofFolds()) if (token === old) keepToken(id, key);
  storeBrought(broughtExcept(key));
  store(OWN, key);
}

// Return the keys that were added from other browsers.
/** @returns {string[]} */
export function broughtKeys() {
  try {
    const keys = JSON.parse(stored(BROUGHT) ?? "[]");
    return Array.isArray(keys)
      ? keys.filter((key) => typeof key === "string" && isKey(key)).slice(0, MOST_KEYS)
      : [];
  } catch {
    return [];
  }
}

const broughtExcept = (/** @type {string} */ key) =>
  broughtKeys().filter((broughtKey) => broughtKey !== key);
const storeBrought = (/** @type {string[]} */ keys) => store(BROUGHT, JSON.stringify(keys));

// Return all keys, the own key first, without creating one.
export function keysHere() {
  const previousKey = stored(OWN);
  return [...new Set([...(previousKey ? [previousKey] : []), ...broughtKeys()])];
}

/** @param {string} key */
export const bring = (key) => storeBrought([...broughtExcept(key), key]);

// Use an added key as the own one; keep the previous own key as an added one.
/** @param {string} key */
export function useKey(key) {
  const previousKey = stored(OWN);
  storeBrought([
    ...(previousKey && previousKey !== key ? [previousKey] : []),
    ...broughtExcept(key),
  ]);
  store(OWN, key);
}

// Remove an added key and its tokens of folds.
/** @param {string} key */
export function dropKey(key) {
  storeBrought(broughtExcept(key));
  for (const [id, token] of ofFolds()) if (token === key) keepToken(id, null);
}

export function forgetKeys() {
  for (const [id] of ofFolds()) keepToken(id, null);
  store(BROUGHT, null);
  store(OWN, null);
}

// Return the tokens of folds that this browser stores.
/** @returns {[id: string, token: string][]} */
function ofFolds() {
  try {
    return Object.keys(localStorage)
      .filter((name) => name.startsWith(OF_FOLD))
      .map((name) => [name.slice(OF_FOLD.length), stored(name) ?? ""]);
  } catch {
    return [];
  }
}

// Return the owner token of a fold; null for folds of others.
/** @param {string} id */
export const tokenOf = (id) => stored(OF_FOLD + id);

// Store the token of a fold, null to remove it. Without
// storage the fold is visible but cannot be cancelled.
/**
 * @param {string} id
 * @param {string | null} token
 */
export const keepToken = (id, token) => store(OF_FOLD + id, token);

// Return the headers that prove ownership; none without a token.
/**
 * @param {string | null} token
 * @returns {Record<string, string>}
 */
export const proof = (token) => (token ? { Authorization: `Bearer ${token}` } : {});
