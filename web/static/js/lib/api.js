// Requests to the service, and the keys of this browser that they are made with: its own, and those brought
// from other browsers. A key is an owner token: whoever holds it holds what was made with it. Keys leave in
// one header alone.
import { UNREACHABLE, at, sentence, store, stored } from "./text.js";

const OWN = "foldback:token";
const BROUGHT = "foldback:keys";
const OF_FOLD = "foldback:owner:";
const KEY = /^[A-Za-z0-9_.~+/=-]{24,200}$/;
const BYTES = 24;
export const MOST_KEYS = 8;
const GONE = new Set([403, 404]);
const BUSY = 429;

const NUMBERED_PARTS = /\b(?:module|cell|angle|triangle)s? \d+\b(?:(?:, | and | to | against )\d+\b)*(?: more)?/gi;

// A text of the planner, which counts modules and cells from 0, counting from 1: `count_from_one` of server/pages/failures.py.
/** @param {string} text */
export const countFromOne = (text) => text.replace(NUMBERED_PARTS, (named) => named.replace(/\d+(?! more)\b/g, (index) => String(Number(index) + 1)));

// A refusal in words for people.
export class Refusal extends Error {
  /**
   * @param {string} words
   * @param {number} status 0 where the server cannot be reached
   * @param {string} code of the API; empty where it gave none
   */
  constructor(words, status = 0, code = "") {
    super(words);
    this.status = status;
    this.code = code;
  }

  // Whether the same request is refused again.
  get final() { return this.status >= 400 && this.status < 500 && this.status !== BUSY; }

  // Whether what was requested is not there, or not with this key.
  get gone() { return GONE.has(this.status); }
}

// Return what the server said as a sentence that also says where.
/**
 * @param {Refused} problem
 * @param {number} status
 */
export function refusalWords({ message, detail, where: place }, status) {
  const text = countFromOne(message ?? detail ?? `The request failed: the server answered with status ${status}.${status === BUSY || status >= 500 ? " Try again later." : ""}`);
  const where = countFromOne(place ?? "");
  return sentence(text.includes(where) || text.includes(where.replaceAll("_", " ")) ? text : `${where}: ${text}`);
}

// Return the JSON of an answer; none is read as {}, because proxies answer in words of their own.
/**
 * @param {number} status
 * @param {string} text
 * @returns {any}
 * @throws {Refusal} for a status other than 2xx
 */
export function contentOf(status, text) {
  let content = {};
  try { content = JSON.parse(text) ?? {}; } catch { /* no JSON */ }
  if (status < 200 || status > 299) throw new Refusal(refusalWords(content, status), status, /** @type {Refused} */ (content).code);
  return content;
}

// Return a form with fields, without those that are null.
/** @param {Form} fields */
export function formOf(fields) {
  const form = new FormData();
  for (const [key, value] of Object.entries(fields)) if (value !== null) form.set(key, value instanceof Blob ? value : String(value));
  return form;
}

// Request something of the service. A body is sent with POST unless a method is named: a form as it is, other
// values as JSON.
/**
 * @template Answer
 * @param {string} path
 * @param {{ method?: string, body?: FormData | object | null, token?: string | null, signal?: AbortSignal }} request
 * @returns {Promise<Answer>}
 * @throws {Refusal}
 */
export async function ask(path, { method, body = null, token = null, signal } = {}) {
  const plain = body !== null && !(body instanceof FormData);
  const sent = {
    method: method ?? (body ? "POST" : "GET"), signal, body: plain ? JSON.stringify(body) : body,
    headers: { ...proof(token), ...(plain && { "Content-Type": "application/json" }) },
  };
  const { status, text } = await fetch(at(path), sent).then(async (answer) => ({ status: answer.status, text: await answer.text() }))
    .catch(() => { throw new Refusal(UNREACHABLE); });
  return contentOf(status, text);
}

// Ask now and then, until `over` says that an answer is the last one, or until what is asked for is gone.
/**
 * @template Answer
 * @param {string} path
 * @param {number} pauseMs
 * @param {(answer: Answer) => boolean} over
 */
export async function askUntil(path, pauseMs, over) {
  for (;;) {
    const answer = await ask(path).catch((error) => error);
    if (answer instanceof Refusal ? answer.gone : over(answer)) return;
    await new Promise((again) => { setTimeout(again, pauseMs); });
  }
}

// Delete something that may be gone already.
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

// The browser's own, made once; none where nothing may be kept. Who sends it again with the same file
// gets the same fold.
export function ownKey() {
  const known = stored(OWN);
  if (known) return known;
  const made = newKey();
  return store(OWN, made) ? made : null;
}

export const newKey = () => btoa(String.fromCharCode(...crypto.getRandomValues(new Uint8Array(BYTES)))).replaceAll("+", "-").replaceAll("/", "_");

// What was made with its own key is a new one's now, which was kept beside it until then.
/** @param {string} made */
export function replaceOwn(made) {
  const old = stored(OWN);
  for (const [id, token] of ofFolds()) if (token === old) keepToken(id, made);
  storeBrought(broughtExcept(made));
  store(OWN, made);
}

// Those that were brought here.
/** @returns {string[]} */
export function broughtKeys() {
  try {
    const told = JSON.parse(stored(BROUGHT) ?? "[]");
    return Array.isArray(told) ? told.filter((key) => typeof key === "string" && isKey(key)).slice(0, MOST_KEYS) : [];
  } catch {
    return [];
  }
}

const broughtExcept = (/** @type {string} */ key) => broughtKeys().filter((other) => other !== key);
const storeBrought = (/** @type {string[]} */ keys) => store(BROUGHT, JSON.stringify(keys));

// All of them, its own first; none is made for it.
export function keysHere() {
  const own = stored(OWN);
  return [...new Set([...(own ? [own] : []), ...broughtKeys()])];
}

/** @param {string} key */
export const bring = (key) => storeBrought([...broughtExcept(key), key]);

// From now on it asks with a key that was brought here; its own stays beside it.
/** @param {string} key */
export function useKey(key) {
  const own = stored(OWN);
  storeBrought([...(own && own !== key ? [own] : []), ...broughtExcept(key)]);
  store(OWN, key);
}

// Forgets a key that was brought here, and of which folds it is.
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

// Which token this browser knows for which fold.
/** @returns {[id: string, token: string][]} */
function ofFolds() {
  try {
    return Object.keys(localStorage).filter((name) => name.startsWith(OF_FOLD)).map((name) => [name.slice(OF_FOLD.length), stored(name) ?? ""]);
  } catch {
    return [];
  }
}

// The token that proves that a fold is this browser's; null for others'.
/** @param {string} id */
export const tokenOf = (id) => stored(OF_FOLD + id);

// Where nothing may be kept a fold is seen all the same; it cannot be cancelled then.
/**
 * @param {string} id
 * @param {string | null} token
 */
export const keepToken = (id, token) => store(OF_FOLD + id, token);

// The headers that prove whose something is; none for a token that is not there.
/**
 * @param {string | null} token
 * @returns {Record<string, string>}
 */
export const proof = (token) => (token ? { Authorization: `Bearer ${token}` } : {});
