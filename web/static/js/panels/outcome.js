// The outcome of a fold that runs while its page is open: the tab's title shows the progress and the
// verdict, the page announces the verdict and, if the visitor asked for it, a hidden tab sends a notification.
import { at, get } from "../lib/text.js";

const MARKS = /** @type {Record<string, string>} */ ({ good: "✓", bad: "✕" });
const ICON = at("/static/icon.svg");

// The title of the tab while a fold runs. Each stage counts from 0.
/**
 * @param {Pick<Api.Progress, "status" | "fraction" | "preparing">} now
 * @param {string} name
 * @param {string} stage
 */
export function titleOf({ status, fraction, preparing }, name, stage) {
  const percent = (/** @type {number | undefined} */ share) => `${Math.floor(100 * (share ?? 0))} %`;
  const waiting = status === "queued" ? "Waiting" : `${stage} ${percent(fraction)}`;
  const share = preparing ? `Preparing ${percent(preparing.fraction)}` : waiting;
  return `${share} · ${name} · foldback`;
}

// The title of the tab and of the notification when it is over.
/** @param {Pick<Facts, "name" | "verdict">} facts */
export const headingOf = ({ name, verdict: { tone } }) => MARKS[tone] ? `${MARKS[tone]} ${name}` : name;

// What the page announces; null where the failure says it.
/** @param {Pick<Facts, "name" | "verdict">} facts */
export const announcementOf = ({ name, verdict: { tone } }) => (tone === "good" ? `✓ ${name} folds: verified` : null);

export class Outcome {
  /** @param {(text: string) => void} toast */
  constructor(toast) {
    this.toast = toast;
    this.notifies = false;
    const button = get("notify");
    button.hidden = !("Notification" in window) || Notification.permission === "denied";
    button.onclick = () => this.ask();
  }

  async ask() {
    this.notifies = await Notification.requestPermission() === "granted";
    get("notify").hidden = true;
    this.toast(this.notifies ? "You will get a notification when this fold is done" : "Notifications are blocked for this site");
  }

  /**
   * @param {Api.Progress} now
   * @param {string} name
   * @param {string} stage
   */
  progress(now, name, stage) { document.title = titleOf(now, name, stage); }

  /** @param {Facts} facts */
  end(facts) {
    get("notify").hidden = true;
    document.title = headingOf(facts);
    const text = announcementOf(facts);
    if (text) this.toast(text);
    get("verdict").classList.add("new"); // a moment that is seen
    if (this.notifies && document.hidden) this.notify(facts);
  }

  /** @param {Facts} facts */
  notify(facts) {
    try {
      const shown = new Notification(headingOf(facts), { body: facts.verdict.text, tag: facts.id, icon: ICON });
      shown.onclick = () => { window.focus(); shown.close(); };
    } catch { /* some phones take notifications of service workers only */ }
  }
}
