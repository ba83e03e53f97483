// Requests for folds.
import { Refusal, formOf, keepToken, ownKey } from "./api.js";
import { at, wordsOf } from "./text.js";
import { upload } from "./upload.js";

// Request a fold with a form or plain fields, and store its owner token.
/**
 * @param {FormData | Form} body
 * @param {import("./upload.js").Sending} options
 * @returns {Promise<{ id: string }>}
 */
export async function requestFold(body, options = {}) {
  const form = body instanceof FormData ? body : formOf(body);
  /** @type {Api.Accepted} */
  const { id, owner_token: token } = await upload("/api/folds", form, {
    ...options,
    token: ownKey(),
  });
  if (token) keepToken(id, token); // an existing fold of another visitor has none
  return { id };
}

// Request a fold and go to its page. Return true if the page is left; report a refusal with `say`.
/**
 * @param {FormData | Form} body
 * @param {(words: string, values: Record<string, any>) => void} say
 * @param {...HTMLButtonElement} buttons that are disabled meanwhile
 */
export async function openFold(body, say, ...buttons) {
  for (const button of buttons) button.disabled = true;
  try {
    location.href = at(`/folds/${(await requestFold(body)).id}`);
    return true;
  } catch (error) {
    say(wordsOf(error), error instanceof Refusal ? error.values : {});
    for (const button of buttons) button.disabled = false;
    return false;
  }
}
