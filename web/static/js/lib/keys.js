// The keys of this browser: its own, with which it asks, and those brought from other browsers. A key
// is an owner token: whoever holds it holds what was made with it. Keys leave in one header alone.

const OWN = "foldback:token";
const BROUGHT = "foldback:keys";
const OF_FOLD = "foldback:owner:";
const KEY = /^[A-Za-z0-9_.~+/=-]{24,200}$/;
const BYTES = 24;
export const MOST_KEYS = 8;

/** @param {string} name */
function kept(name) {
  try { return localStorage.getItem(name); } catch { return null; }
}

// False where nothing may be kept: storage is full, or refused by the browser.
/**
 * @param {string} name
 * @param {string | null} value
 */
function keep(name, value) {
  try {
    if (value === null) localStorage.removeItem(name);
    else localStorage.setItem(name, value);
    return true;
  } catch {
    return false;
  }
}

/** @param {string} text */
export const isKey = (text) => KEY.test(text);

// The browser's own, made once; none where nothing may be kept. Who sends it again with the same file
// gets the same fold.
export function ownKey() {
  const known = kept(OWN);
  if (known) return known;
  const made = newKey();
  return keep(OWN, made) ? made : null;
}

export const newKey = () => btoa(String.fromCharCode(...crypto.getRandomValues(new Uint8Array(BYTES)))).replaceAll("+", "-").replaceAll("/", "_");

// What was made with its own key is a new one's now, which was kept beside it until then.
/** @param {string} made */
export function replaceOwn(made) {
  const old = kept(OWN);
  for (const [id, token] of ofFolds()) if (token === old) keepToken(id, made);
  keep(BROUGHT, JSON.stringify(broughtKeys().filter((key) => key !== made)));
  keep(OWN, made);
}

// Those that were brought here.
/** @returns {string[]} */
export function broughtKeys() {
  try {
    const told = JSON.parse(kept(BROUGHT) ?? "[]");
    return Array.isArray(told) ? told.filter((key) => typeof key === "string" && isKey(key)).slice(0, MOST_KEYS) : [];
  } catch {
    return [];
  }
}

// All of them, its own first; none is made for it.
export function keysHere() {
  const own = kept(OWN);
  return [...new Set([...(own ? [own] : []), ...broughtKeys()])];
}

/** @param {string} key */
export const bring = (key) => keep(BROUGHT, JSON.stringify([...broughtKeys().filter((other) => other !== key), key]));

// From now on it asks with a key that was brought here; its own stays beside it.
/** @param {string} key */
export function useKey(key) {
  const own = kept(OWN);
  const others = broughtKeys().filter((other) => other !== key);
  keep(BROUGHT, JSON.stringify(own && own !== key ? [own, ...others] : others));
  keep(OWN, key);
}

// Forgets a key that was brought here, and of which folds it is.
/** @param {string} key */
export function dropKey(key) {
  keep(BROUGHT, JSON.stringify(broughtKeys().filter((other) => other !== key)));
  for (const [id, token] of ofFolds()) if (token === key) keepToken(id, null);
}

export function forgetKeys() {
  for (const [id] of ofFolds()) keepToken(id, null);
  keep(BROUGHT, null);
  keep(OWN, null);
}

// Which token this browser knows for which fold.
/** @returns {[id: string, token: string][]} */
function ofFolds() {
  try {
    const names = Object.keys(localStorage).filter((name) => name.startsWith(OF_FOLD));
    return names.map((name) => [name.slice(OF_FOLD.length), localStorage.getItem(name) ?? ""]);
  } catch {
    return [];
  }
}

// Folds with tokens of their own, as earlier versions gave them.
export function foldsApart() {
  const here = keysHere();
  return ofFolds().filter(([, token]) => !here.includes(token));
}

// The token that proves that a fold is this browser's; null for others'.
/** @param {string} id */
export const tokenOf = (id) => kept(OF_FOLD + id);

// Where nothing may be kept a fold is seen all the same; it cannot be cancelled then.
/**
 * @param {string} id
 * @param {string | null} token
 */
export const keepToken = (id, token) => keep(OF_FOLD + id, token);

// The headers that prove whose something is; none for a token that is not there.
/**
 * @param {string | null} token
 * @returns {Record<string, string>}
 */
export const proof = (token) => (token ? { Authorization: `Bearer ${token}` } : {});
