// Sending a form, told how much of it has gone: XMLHttpRequest tells, fetch does not.
export const STOPPED = "Stopped";

/**
 * @typedef {{ ok: boolean, status: number, told: any }} Answer told: its JSON, or {}
 * @typedef {{ headers?: Record<string, string>, signal?: AbortSignal, onSent?: (sent: number, all: number) => void }} Sending
 */

// The answer. Throws an Error "Stopped" when the signal ends it, any other when there is no answer.
/**
 * @param {string} address
 * @param {FormData} form
 * @param {Sending} how
 * @returns {Promise<Answer>}
 */
export function posted(address, form, { headers = {}, signal, onSent } = {}) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const stop = () => request.abort();
    request.open("POST", address);
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    // Without a listener none is told, and no event is sent for what goes elsewhere.
    if (onSent) request.upload.onprogress = ({ loaded, total }) => onSent(loaded, total);
    request.onload = () => {
      let told = {};
      try { told = JSON.parse(request.responseText); } catch { /* a proxy answers in its own words */ }
      resolve({ ok: request.status >= 200 && request.status < 300, status: request.status, told });
    };
    request.onerror = () => reject(new Error("unreachable"));
    request.onabort = () => reject(new Error(signal?.aborted ? STOPPED : "unreachable"));
    request.onloadend = () => signal?.removeEventListener("abort", stop);
    if (signal?.aborted) { reject(new Error(STOPPED)); return; }
    signal?.addEventListener("abort", stop);
    request.send(form);
  });
}
