// Asking for a fold.
import { refusal, wordsOf } from "./text.js";
import { STOPPED, posted } from "./upload.js";

const OWN = "foldback:token";
export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// The token of this browser, made once; none where nothing may be kept. Who sends it again with the
// same file gets the same fold.
function ownToken() {
  try {
    let token = localStorage.getItem(OWN);
    if (!token) {
      token = btoa(String.fromCharCode(...crypto.getRandomValues(new Uint8Array(24)))).replaceAll("+", "-").replaceAll("/", "_");
      localStorage.setItem(OWN, token);
    }
    return token;
  } catch {
    return null;
  }
}

// The headers that prove whose a fold is; none for a token that is not there.
/**
 * @param {string | null} token
 * @returns {Record<string, string>}
 */
export const proof = (token) => (token ? { Authorization: `Bearer ${token}` } : {});

// The token that proves that a fold is this browser's; null for others'.
/** @param {string} id */
export function tokenOf(id) {
  try { return localStorage.getItem(`foldback:owner:${id}`); } catch { return null; }
}

// Asks for a fold with form data or plain fields, and keeps the token that proves whose it is.
// Throws an Error with words for people when it was refused.
/**
 * @param {FormData | Form} body
 * @param {import("./upload.js").Sending} how
 * @returns {Promise<{ id: string }>}
 */
export async function foldAsked(body, how = {}) {
  const form = body instanceof FormData ? body : new FormData();
  if (!(body instanceof FormData)) {
    for (const [key, value] of Object.entries(body)) form.set(key, value instanceof Blob ? value : String(value));
  }
  let answer;
  try {
    answer = await posted("/api/folds", form, { ...how, headers: proof(ownToken()) });
  } catch (error) {
    throw new Error(wordsOf(error) === STOPPED ? STOPPED : UNREACHABLE, { cause: error });
  }
  const { told } = answer;
  if (!answer.ok) throw new Error(refusal(told, answer.status));
  keepToken(told);
  return told;
}

// The same, and goes to its page. Returns why it could not be, in words; an empty text means that the
// page is being left.
/** @param {FormData | Form} body */
export async function askForFold(body) {
  try {
    location.href = `/folds/${(await foldAsked(body)).id}`;
    return "";
  } catch (error) {
    return wordsOf(error);
  }
}

// Another's fold, or one of the gallery that others have asked for, comes without. Where nothing may
// be kept the fold is seen all the same; it cannot be cancelled then.
/** @param {{ id: string, owner_token?: string }} told */
function keepToken({ id, owner_token: token }) {
  try {
    if (token) localStorage.setItem(`foldback:owner:${id}`, token);
  } catch { /* storage is full, or refused by the browser */ }
}
