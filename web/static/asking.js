// Asking for a fold.
import { refusal } from "./words.js";

export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// Asks for a fold with form data or plain fields, and keeps the token that proves whose it is.
// Throws an Error with words for people when it was refused.
export async function foldAsked(body) {
  let form = body;
  if (!(form instanceof FormData)) {
    form = new FormData();
    for (const [key, value] of Object.entries(body)) form.set(key, value instanceof Blob ? value : String(value));
  }
  let answer;
  try {
    answer = await fetch("/api/folds", { method: "POST", body: form });
  } catch {
    throw new Error(UNREACHABLE);
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(refusal(told, answer.status));
  keepToken(told);
  return told;
}

// The same, and goes to its page. Returns why it could not be, in words; an empty text means that the
// page is being left.
export async function askForFold(body) {
  try {
    location.href = `/folds/${(await foldAsked(body)).id}`;
    return "";
  } catch (error) {
    return error.message;
  }
}

// Where nothing may be kept the fold is seen all the same; it cannot be cancelled then.
function keepToken({ id, owner_token: token }) {
  try {
    if (token) localStorage.setItem(`foldback:owner:${id}`, token);
  } catch { /* storage is full, or refused by the browser */ }
}
