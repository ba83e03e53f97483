// Progress of a running fold: stage, percentage, steps per second, position in the queue.
import { Refusal, ask, askUntil, tokenOf } from "../lib/api.js";
import { awaitOutcome, headingOf, titleOf } from "./outcome.js";
import { OverallProgress, queueWords } from "./overall_progress.js";
import { preparingWords, remaining, showPreparing } from "./preparing.js";
import { at, get, toast, whole } from "../lib/text.js";

const ASK_MS = 5000; // between two requests without an event stream
const FORBIDDEN = 403;
const CANCEL_MS = 10000;
const READY = "getting ready";
const NARROW = "(max-width: 640px)"; // on narrower screens the full text would need a second line
const WRITING = "export"; // the stage after the check of a plan
const OVER = ["verified", "failed", "cancelled"];

export class Progress {
  /**
   * @param {Facts} facts
   * @param {() => Promise<Facts | null>} onDone updates the page, and returns the facts of the outcome
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
    /** @type {Facts["verdict"] | null} */
    this.verdict = null; // known before the files of the plan are written
    this.asking = false;
    this.listen();
    get("cancel").onclick = () => this.cancel();
  }

  listen() {
    get("progress").hidden = false;
    this.offer();
    const events = new EventSource(at(`/api/folds/${this.facts.id}/events`));
    this.events = events;
    events.addEventListener("progress", (event) => this.show(JSON.parse(event.data)));
    events.onopen = () => this.pollNoMore();
    events.onerror = () => { if (!this.polling) this.poll(); };
    events.addEventListener("done", () => this.end());
  }

  // The stream is broken, or refused because too many
  // are open: poll until the end or until it is back.
  async poll() {
    this.polling = new AbortController();
    const { signal } = this.polling;
    await askUntil(`/api/folds/${this.facts.id}`, ASK_MS, (/** @type {Api.Fold} */ { progress }) => {
      this.show(progress);
      return OVER.includes(progress.status);
    }, signal).catch(() => {}); // deleted meanwhile
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
    if (now.status === "running" && now.stage === WRITING) this.checked();
    else this.verdict = null;
    this.offer();
    const { preparing } = now;
    const name = get("name").textContent; // the owner may rename the fold meanwhile
    const shown = { ...now, ...(now.status === "running" && { fraction: advance.fraction }) };
    document.title = this.verdict ? headingOf({ name, verdict: this.verdict }) : titleOf(shown, name, advance.name());
    const queue = now.queue_position ?? 0;
    let text = advance.name();
    const left = now.remaining_s == null ? "" : ` · ${remaining(now.remaining_s)}`;
    if (this.cancelling) text = "Cancelling…";
    else if (preparing) text = `${preparingWords(preparing)}${queue > 1 ? ` · then this fold waits in the queue behind ${queue - 1} other fold${queue > 2 ? "s" : ""}` : ""}`;
    else if (now.status === "queued") {
      if (now.paused) text = now.message ?? "Paused";
      else text = queueWords(queue, now.running_before);
      if (now.wait_s != null) text += left;
      else if (queue > 0) text += " · the server computes no folds right now, so this fold waits";
    } else if (now.message === READY) text = "Getting ready";
    else {
      const parts = [`${text} ${Math.floor(100 * advance.fraction)} %${advance.words()}${left}`];
      if (now.steps) parts.push(`${whole(now.steps)} steps`);
      const room = !left || !matchMedia(NARROW).matches;
      if (room && now.simulated_s) parts.push(`${whole(advance.simulatedS)} s simulated`);
      else if (room && now.steps_per_second) parts.push(`${whole(now.steps_per_second)} steps/s`);
      text = parts.join(" · ");
    }
    this.say(text);
    const bar = /** @type {HTMLElement} */ (get("progress").firstElementChild);
    const done = now.status === "queued" ? 0 : advance.fraction;
    bar.style.transform = `scaleX(${preparing ? preparing.fraction : done})`;
    showPreparing(preparing);
  }

  // Hide the buttons to cancel and to be notified once there is a verdict.
  offer() {
    get("cancel").hidden = !this.token || Boolean(this.verdict);
    if (this.verdict) get("notify").hidden = true;
  }

  // Show the verdict of the checked plan while its files are written.
  async checked() {
    if (this.verdict || this.asking) return;
    this.asking = true;
    /** @type {Facts | null} */
    const facts = await ask(`/folds/${this.facts.id}/facts`).catch(() => null);
    this.asking = false;
    if (!facts?.running || facts.verdict.tone !== "good" || get("progress").hidden) return;
    this.verdict = facts.verdict;
    if (this.now) this.show(this.now);
  }

  /** @param {string} text */
  say(text) {
    const { tone, text: words } = this.verdict ?? { tone: "busy", text };
    get("verdict").dataset.tone = tone;
    get("verdict").textContent = words;
    if (!get("cover").classList.contains("gone")) get("cover-text").textContent = text;
  }

  async end() {
    this.events?.close();
    this.pollNoMore();
    get("progress").hidden = true;
    get("cancel").hidden = true;
    showPreparing(null);
    const facts = await this.onDone();
    if (facts) this.announce(facts);
  }

  async cancel() {
    get("cancel").disabled = true;
    this.cancelling = true;
    this.say("Cancelling…");
    try {
      await ask(`/api/folds/${this.facts.id}/cancel`, { method: "POST", token: this.token });
      setTimeout(() => { this.cancelling = false; }, CANCEL_MS);
    } catch (error) {
      const shared = error instanceof Refusal && error.status === FORBIDDEN;
      this.cancelling = false;
      if (shared) this.token = null;
      if (this.now) this.show(this.now);
      get("cancel").disabled = false;
      toast(shared ? "Other people requested this fold too, so it will keep running" : "The fold could not be cancelled");
    }
  }
}
