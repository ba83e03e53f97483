// Asking for a fold.
import { refusal } from "./words.js";

export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// Asks for a fold, keeps the token that proves whose it is, and goes to its page.
// Takes form data or plain fields. Returns why it could not be, in words; an empty text means that
// the page is being left.
export async function askForFold(body) {
  let form = body;
  if (!(form instanceof FormData)) {
    form = new FormData();
    for (const [key, value] of Object.entries(body)) form.set(key, String(value));
  }
  let answer;
  try {
    answer = await fetch("/api/folds", { method: "POST", body: form });
  } catch {
    return UNREACHABLE;
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) return refusal(told, answer.status);
  keepToken(told);
  location.href = `/folds/${told.id}`;
  return "";
}

// Where nothing may be kept the fold is seen all the same; it cannot be cancelled then.
function keepToken({ id, owner_token: token }) {
  try {
    if (token) localStorage.setItem(`foldback:owner:${id}`, token);
  } catch { /* storage is full, or refused by the browser */ }
}
