// Upload of a form with progress events: XMLHttpRequest has them, fetch has none.
import { Refusal, contentOf, proof } from "./api.js";
import { UNREACHABLE, at } from "./text.js";

export const STOPPED = "Stopped";

/** @typedef {{ signal?: AbortSignal, onSent?: (sent: number, all: number) => void }} Sending */

// Send a form and return the answer.
/**
 * @template Answer
 * @param {string} path
 * @param {FormData} form
 * @param {Sending & { token?: string | null }} how
 * @returns {Promise<Answer>}
 * @throws {Refusal} with the message "Stopped" if the signal aborts it
 */
export function upload(path, form, { token = null, signal, onSent } = {}) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", at(path));
    for (const [name, value] of Object.entries(proof(token))) request.setRequestHeader(name, value);
    // A listener would make a cross-origin request need a preflight.
    if (onSent) request.upload.onprogress = ({ loaded, total }) => onSent(loaded, total);
    request.onload = () => {
      try {
        resolve(contentOf(request.status, request.responseText));
      } catch (error) {
        reject(error);
      }
    };
    request.onerror = request.onabort = () =>
      reject(new Refusal(signal?.aborted ? STOPPED : UNREACHABLE));
    if (signal?.aborted) {
      reject(new Refusal(STOPPED));
      return;
    }
    signal?.addEventListener("abort", () => request.abort());
    request.send(form);
  });
}
