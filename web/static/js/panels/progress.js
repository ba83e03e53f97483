// Progress of a running fold: stage, percentage, steps per second, position in the queue.
import { Refusal, ask, tokenOf } from "../lib/api.js";
import { OverallProgress, queueWords } from "./overall_progress.js";
import { preparingWords, remaining, showPreparing } from "./preparing.js";
import { at, get, toast, whole } from "../lib/text.js";

const ASK_MS = 1000; // initial interval of polling without an event stream
const LONGEST_ASK_MS = 10000;
const LONGER = 1.5;
const LOST = 404;
const FORBIDDEN = 403;
const CANCEL_MS = 10000;
const READY = "getting ready";
const NARROW = "(max-width: 640px)"; // on narrower screens the full text would need a second line
const WRITING = "export"; // the stage after the check of a plan
const OVER = ["verified", "failed", "cancelled"];

export class Progress {
  /**
   * @param {Facts} facts
   * @param {{ onDone: () => void, onProgress: (now: Api.Progress, stage: string, verdict: Facts["verdict"] | null) => void }} around
   */
  constructor(facts, { onDone, onProgress }) {
    this.facts = facts;
    this.onDone = onDone;
    this.onProgress = onProgress;
    this.token = tokenOf(facts.id);
    this.advance = new OverallProgress();
    this.cancelling = false;
    /** @type {EventSource | null} */
    this.events = null;
    /** @type {ReturnType<typeof setTimeout> | null} */
    this.pollTimer = null;
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
    // The stream is broken, or refused because too many
    // are open: poll until the end or until it is back.
    events.onerror = () => { if (!this.pollTimer) this.poll(ASK_MS); };
    events.addEventListener("done", () => this.end());
  }

  /** @param {number} pause */
  poll(pause) {
    this.pollTimer = setTimeout(async () => {
      /** @type {Api.Fold | Refusal} */
      const answer = await ask(`/api/folds/${this.facts.id}`).catch((error) => error);
      if (!this.pollTimer) return; // the stream is back
      const now = answer instanceof Refusal ? null : answer.progress;
      if (now ? OVER.includes(now.status) : answer.status === LOST) this.end();
      else {
        if (now) this.show(now);
        this.poll(Math.min(LONGER * pause, LONGEST_ASK_MS));
      }
    }, pause);
  }

  pollNoMore() {
    clearTimeout(this.pollTimer ?? undefined);
    this.pollTimer = null;
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
    this.onProgress({ ...now, ...(now.status === "running" && { fraction: advance.fraction }) }, advance.name(), this.verdict);
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

  end() {
    this.events?.close();
    this.pollNoMore();
    get("progress").hidden = true;
    get("cancel").hidden = true;
    showPreparing(null);
    this.onDone();
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
