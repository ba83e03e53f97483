// Asking for a fold: the answer's owner token is kept, and its page opened.
import { refusal } from "./words.js";

export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// What was asked for, with its id; throws an Error with words for people when it was refused.
export async function askForFold(fields) {
  const body = new FormData();
  for (const [key, value] of Object.entries(fields)) if (value !== null && value !== undefined) body.set(key, value);
  let answer;
  try {
    answer = await fetch("/api/folds", { method: "POST", body });
  } catch {
    throw new Error(UNREACHABLE);
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(refusal(told, answer.status));
  if (told.owner_token) localStorage.setItem(`foldback:owner:${told.id}`, told.owner_token);
  return told;
}
