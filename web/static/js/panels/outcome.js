// The outcome of a fold that runs while its page is open: the title of the
// tab shows the progress and the verdict, the page announces the verdict,
// and a hidden tab sends a notification if the visitor wants one.
import { at, get } from "../lib/text.js";

const MARKS = /** @type {Record<string, string>} */ ({ good: "✓", bad: "✕" });
const ICON = at("/static/icon.svg");

// Return the title of the tab while a fold runs. The percentage of each stage starts at 0.
/**
 * @param {string} status
 * @param {string} name
 * @param {Pick<import("./overall_progress.js").OverallProgress, "label">} advance
 */
export const titleOf = (status, name, advance) =>
  `${status === "queued" ? "Waiting" : advance.label()} · ${name} · foldback`;

// Return the title of the tab and of the notification after the fold.
/** @param {Pick<Facts, "name" | "verdict">} facts */
export const headingOf = ({ name, verdict: { tone } }) =>
  MARKS[tone] ? `${MARKS[tone]} ${name}` : name;

// Return the announcement of the page; null if the failure card reports the outcome.
/** @param {Pick<Facts, "name" | "verdict">} facts */
export const announcementOf = ({ name, verdict: { tone } }) =>
  tone === "good" ? `✓ ${name}: fold verified` : null;

// Offer a notification. Return the function that reports the end of the fold.
/**
 * @param {(text: string) => void} toast
 * @returns {(facts: Facts) => void}
 */
export function awaitOutcome(toast) {
  const button = get("notify");
  let notifies = false;
  button.hidden = !("Notification" in window) || Notification.permission === "denied";
  button.onclick = async () => {
    notifies = (await Notification.requestPermission()) === "granted";
    button.hidden = true;
    toast(
      notifies
        ? "You will get a notification when this fold is done"
        : "Notifications are blocked for this site",
    );
  };
  return (facts) => {
    const text = announcementOf(facts);
    button.hidden = true;
    document.title = headingOf(facts);
    if (text) toast(text);
    get("verdict").classList.add("new"); // highlights it for a moment
    if (!notifies || !document.hidden) return;
    try {
      const notification = new Notification(headingOf(facts), {
        body: facts.verdict.text,
        tag: facts.id,
        icon: ICON,
      });
      notification.onclick = () => {
        window.focus();
        notification.close();
      };
    } catch {
      /* some phones allow notifications only from service workers */
    }
  };
}
