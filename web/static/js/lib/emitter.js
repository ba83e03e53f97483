// Something that tells what is: events with a name and a detail.
export class Emitter extends EventTarget {
  /**
   * @param {string} name
   * @param {unknown} [detail]
   */
  tell(name, detail = null) { this.dispatchEvent(new CustomEvent(name, { detail })); }

  /**
   * @template Told
   * @param {string} name
   * @param {(detail: Told) => void} heard
   */
  on(name, heard) { this.addEventListener(name, (event) => heard(/** @type {CustomEvent<Told>} */ (event).detail)); }
}
