// The frame in the bar: told, and typed on a click. Enter goes there, Escape leaves it as it was.
import { get, whole } from "../lib/text.js";

// The frame that a text names, told from 1 as on the page; null when there is no such frame.
/**
 * @param {string} text
 * @param {number} frames
 */
export function frameIn(text, frames) {
  const digits = text.replace(/\s/g, "");
  const number = /^\d{1,9}$/.test(digits) ? Number(digits) : 0;
  return number >= 1 && number <= frames ? number - 1 : null;
}

export class FrameField {
  /** @param {Playing} player */
  constructor(player) {
    this.player = player;
    this.button = get("r-frame");
    this.field = get("frame");
    this.frame = 0;
    this.frames = 0;
    /** @type {HTMLElement | null} where the keyboard was before, but for a button that was clicked */
    this.before = null;
    this.button.onclick = ({ detail }) => this.open(detail > 0);
    this.field.onkeydown = (event) => this.key(event);
    this.field.oninput = () => this.refuse("");
    this.field.onblur = () => this.close(frameIn(this.field.value, this.frames)); // some keyboards have no Enter
  }

  /** @param {State} state */
  show({ frame, frames }) {
    this.frame = Math.round(frame);
    this.frames = frames;
    this.button.hidden = !this.field.hidden;
    this.button.textContent = this.words;
  }

  get words() { return `Frame ${whole(this.frame + 1)} of ${whole(this.frames)}`; }

  // `clicked` says that a pointer has opened it, which leaves the keyboard to the page.
  open(clicked = false) {
    if (!this.frames) return;
    const { activeElement } = document;
    this.before = !clicked && activeElement instanceof HTMLElement ? activeElement : null;
    this.player.send({ do: "pause" });
    this.refuse("");
    this.field.value = String(this.frame + 1);
    this.field.setAttribute("aria-label", `Frame to go to, from 1 to ${this.frames}`);
    this.field.hidden = false;
    this.button.hidden = true;
    this.field.select();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.isComposing || (event.key !== "Enter" && event.key !== "Escape")) return;
    event.preventDefault();
    event.stopPropagation();
    const frame = event.key === "Enter" ? frameIn(this.field.value, this.frames) : this.frame;
    if (frame === null) {
      this.refuse(`Enter a whole number from 1 to ${this.frames}.`);
      return;
    }
    this.close(frame);
    this.before?.focus();
  }

  // Says why it does not go there; nothing when all is well.
  /** @param {string} why */
  refuse(why) {
    this.field.setCustomValidity(why);
    this.field.setAttribute("aria-invalid", String(why !== ""));
    if (why) this.field.reportValidity();
  }

  /** @param {number | null} frame */
  close(frame) {
    if (this.field.hidden) return;
    this.button.hidden = false;
    this.field.hidden = true;
    if (frame !== null && frame !== this.frame) this.player.send({ do: "seek", frame });
  }
}
