// Asking for a fold.
import { keepToken, ownKey, proof } from "./keys.js";
import { UNREACHABLE, refusal, wordsOf } from "./text.js";
import { STOPPED, posted } from "./upload.js";

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
    answer = await posted("/api/folds", form, { ...how, headers: proof(ownKey()) });
  } catch (error) {
    throw new Error(wordsOf(error) === STOPPED ? STOPPED : UNREACHABLE, { cause: error });
  }
  const { told } = answer;
  if (!answer.ok) throw new Error(refusal(told, answer.status));
  if (told.owner_token) keepToken(told.id, told.owner_token); // another's comes without
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
