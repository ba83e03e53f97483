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

// Request a fold and go to its page. Return the refusal in words; an empty text means that the page is left.
/** @param {FormData | Form} body */
export async function openFold(body) {
  try {
    location.href = at(`/folds/${(await requestFold(body)).id}`);
    return "";
  } catch (error) {
    return wordsOf(error);
  }
}
