// Upload progress: a bar and a button to stop, for uploads that take longer than a moment.
import { button, element } from "../lib/text.js";

const SOON_MS = 500;

/** @param {number} value in bytes */
const megabytes = (value) => `${(value / 1e6).toFixed(value < 1e7 ? 1 : 0)} MB`;

export class Sending {
  /** @param {HTMLElement} host container of the progress, empty until then */
  constructor(host) {
    this.host = host;
    /** @type {AbortController | null} */
    this.control = null;
  }

  // Run an upload with an abort signal and progress reports; abort a previous one first.
  /**
   * @template Done
   * @param {string} name
   * @param {(how: { signal: AbortSignal, onSent: (sent: number,
   *   all: number) => void }) => Promise<Done>} send
   * @returns {Promise<Done>}
   */
  async during(name, send) {
    this.control?.abort();
    const control = new AbortController();
    this.control = control;
    const bar = element("progress", { max: "1", "aria-label": `Sending ${name}` });
    const text = element("span", { class: "sending-text" }, `Sending ${name}`);
    const stop = button("button quiet", "Stop", () => control.abort());
    const soon = setTimeout(() => {
      this.host.replaceChildren(element("div", { class: "sending" }, bar, text, stop));
      this.host.scrollIntoView({ block: "nearest" });
    }, SOON_MS);
    const onSent = (/** @type {number} */ sent, /** @type {number} */ all) => {
      if (sent < all) {
        bar.value = sent / all;
        text.textContent =
          `Sending ${name}: ${Math.floor((100 * sent) / all)} %, ` +
          `${megabytes(sent)} of ${megabytes(all)}`;
      } else {
        bar.removeAttribute("value"); // everything is sent; the server reads it
        text.textContent = `Reading ${name}…`;
      }
    };
    try {
      return await send({ signal: control.signal, onSent });
    } finally {
      clearTimeout(soon);
      if (this.control === control) {
        this.control = null;
        this.host.replaceChildren();
      }
    }
  }
}
