// Requests for folds.
import { formOf, keepToken, ownKey } from "./api.js";
import { at, wordsOf } from "./text.js";
import { upload } from "./upload.js";

// Request a fold with a form or plain fields, and store the token that proves whose it is.
/**
 * @param {FormData | Form} body
 * @param {import("./upload.js").Sending} how
 * @returns {Promise<{ id: string }>}
 */
export async function requestFold(body, how = {}) {
  const form = body instanceof FormData ? body : formOf(body);
  /** @type {Api.Accepted} */
  const { id, owner_token: token } = await upload("/api/folds", form, { ...how, token: ownKey() });
  if (token) keepToken(id, token); // a fold of somebody else comes without
  return { id };
}

// Request a fold and go to its page. Return whether the page is left; a refusal is said.
/**
 * @param {FormData | Form} body
 * @param {(words: string) => void} say
 * @param {...HTMLButtonElement} buttons that rest meanwhile
 */
export async function openFold(body, say, ...buttons) {
  for (const button of buttons) button.disabled = true;
  try {
    location.href = at(`/folds/${(await requestFold(body)).id}`);
    return true;
  } catch (error) {
    say(wordsOf(error));
    for (const button of buttons) button.disabled = false;
    return false;
  }
}
