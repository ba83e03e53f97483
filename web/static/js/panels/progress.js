// Progress of a running fold: stage, percentage, steps per second, position in the queue.
import { Refusal, ask, askUntil, tokenOf } from "../lib/api.js";
import { awaitOutcome, titleOf } from "./outcome.js";
import { OverallProgress, queueWords, remaining } from "./overall_progress.js";
import { at, get, toast, integerText } from "../lib/text.js";

const ASK_MS = 5000; // between two requests without an event stream
const FORBIDDEN = 403;
const CANCEL_MS = 10000;
const NARROW = "(max-width: 640px)"; // on narrower screens the full text would need a second line
const OVER = ["verified", "failed", "cancelled"];

export class Progress {
  /**
   * @param {Facts} facts
   * @param {() => Promise<Facts | null>} onDone updates the page, and returns the facts of the
   *   outcome
   */
  constructor(facts, onDone) {
    this.facts = facts;
    this.onDone = onDone;
    this.announce = awaitOutcome(toast);
    this.token = tokenOf(facts.id);
    this.advance = new OverallProgress();
    this.cancelling = false;
    /** @type {EventSource | null} */
    this.events = null;
    /** @type {AbortController | null} */
    this.polling = null;
    /** @type {Api.Progress | null} */
    this.now = null;
    this.listen();
    get("cancel").onclick = () => this.cancel();
  }

  listen() {
    get("progress").hidden = false;
    get("cancel").hidden = !this.token;
    const events = new EventSource(at(`/api/folds/${this.facts.id}/events`));
    this.events = events;
    events.addEventListener("progress", (event) => this.show(JSON.parse(event.data)));
    events.onopen = () => this.pollNoMore();
    events.onerror = () => {
      if (!this.polling) this.poll();
    };
    events.addEventListener("done", () => this.end());
  }

  // The stream is broken, or refused because too many
  // are open: poll until the end or until it is back.
  async poll() {
    this.polling = new AbortController();
    const { signal } = this.polling;
    await askUntil(
      `/api/folds/${this.facts.id}`,
      ASK_MS,
      (/** @type {Api.Fold} */ { progress }) => {
        this.show(progress);
        return OVER.includes(progress.status);
      },
      signal,
    ).catch(() => {}); // deleted meanwhile
    if (!signal.aborted) this.end();
  }

  pollNoMore() {
    this.polling?.abort();
    this.polling = null;
  }

  /** @param {Api.Progress} now */
  show(now) {
    this.now = now;
    if (OVER.includes(now.status)) return; // the verdict follows
    const { advance } = this;
    if (now.status === "running") advance.note(now);
    get("cancel").hidden = !this.token;
    const name = get("name").textContent; // the owner may rename the fold meanwhile
    document.title = titleOf(now.status, name, advance);
    const queue = now.queue_position ?? 0;
    let text;
    const remainingWords =
      now.remaining_s == null ? "" : ` · ${remaining(now.remaining_s, now.busy)}`;
    if (this.cancelling) text = "Cancelling…";
    else if (now.status === "queued") {
      if (now.paused) text = now.message ?? "Paused";
      else text = queueWords(queue, now.running_before);
      if (now.wait_s != null) text += remainingWords;
      else if (queue > 0) text += " · the server computes no folds right now, so this fold waits";
    } else if (advance.writing || advance.verified) text = advance.label();
    else {
      const parts = [`${advance.label()}${advance.words()}${remainingWords}`];
      if (now.steps) parts.push(`${integerText(now.steps)} steps`);
      const room = !remainingWords || !matchMedia(NARROW).matches;
      if (room && now.simulated_s) parts.push(`${integerText(advance.simulatedS)} s simulated`);
      else if (room && now.steps_per_second)
        parts.push(`${integerText(now.steps_per_second)} steps/s`);
      text = parts.join(" · ");
    }
    this.say(text);
    const bar = /** @type {HTMLElement} */ (get("progress").firstElementChild);
    const done = now.status === "queued" ? 0 : advance.fraction;
    bar.style.transform = `scaleX(${done})`;
    get("progress").classList.toggle("unmeasured", now.status === "running" && advance.writing);
  }

  /** @param {string} text */
  say(text) {
    get("verdict").dataset.tone = "busy";
    get("verdict").textContent = text;
    if (!get("cover").classList.contains("gone")) get("cover-text").textContent = text;
  }

  async end() {
    this.events?.close();
    this.pollNoMore();
    get("progress").hidden = true;
    get("cancel").hidden = true;
    const facts = await this.onDone();
    if (facts) this.announce(facts);
  }

  async cancel() {
    get("cancel").disabled = true;
    this.cancelling = true;
    this.say("Cancelling…");
    try {
      await ask(`/api/folds/${this.facts.id}/cancel`, { method: "POST", token: this.token });
      setTimeout(() => {
        this.cancelling = false;
      }, CANCEL_MS);
    } catch (error) {
      const shared = error instanceof Refusal && error.status === FORBIDDEN;
      this.cancelling = false;
      if (shared) this.token = null;
      if (this.now) this.show(this.now);
      get("cancel").disabled = false;
      toast(
        shared
          ? "Other people requested this fold too, so it will keep running"
          : "The fold could not be cancelled",
      );
    }
  }
}
