// A fold while it is computed: stage, share, steps a second, place in the queue.
import { STAGES, duration, whole } from "./words.js";

const RETRY_MS = 10000;
const CANCEL_MS = 10000;
const LONG_MS = 4000;
const READY = "getting ready";
const SMOOTHING = "smoothing"; // in place of an explosion
const OVER = ["verified", "failed", "cancelled"];
const get = (id) => document.getElementById(id);

// Where nothing may be kept nobody can be told from others.
function kept(key) {
  try { return localStorage.getItem(key); } catch { return null; }
}

export class Progress {
  constructor(facts, { onDone, toast }) {
    this.facts = facts;
    this.onDone = onDone;
    this.toast = toast;
    this.token = kept(`foldback:owner:${facts.id}`);
    if (facts.running) this.listen();
    get("cancel").onclick = () => this.cancel();
  }

  listen() {
    get("progress").hidden = false;
    get("cancel").hidden = !this.token;
    const events = new EventSource(`/api/folds/${this.facts.id}/events`);
    events.addEventListener("progress", (event) => this.show(JSON.parse(event.data)));
    // A browser comes back by itself, unless it was answered that too many follow just now.
    events.onerror = () => { if (events.readyState === EventSource.CLOSED) setTimeout(() => this.listen(), RETRY_MS); };
    events.addEventListener("done", () => { events.close(); this.end(); });
  }

  show(now) {
    if (now.message !== READY) clearTimeout(this.waiting);
    if (OVER.includes(now.status)) return; // the verdict follows
    let text = now.message === SMOOTHING ? "Smoothing" : STAGES[now.stage] ?? "Waiting";
    if (this.cancelling) text = "Cancelling…";
    else if (now.status === "queued") {
      text = now.queue_position > 0 ? `In the queue, place ${now.queue_position}` : "In the queue";
      if (now.wait_s != null) text += ` · ${duration(now.wait_s)}`;
      else if (now.queue_position > 0) text += " · no worker is running just now";
    } else if (now.message === READY) {
      text = "Getting ready";
      this.waiting ??= setTimeout(() => this.say(`${text} · the first fold takes a minute longer`), LONG_MS);
    } else {
      const parts = [`${text} ${Math.floor(100 * (now.fraction ?? 0))} %`];
      if (now.steps) parts.push(`${whole(now.steps)} steps`);
      if (now.steps_per_second) parts.push(`${whole(now.steps_per_second)} steps/s`);
      text = parts.join(" · ");
    }
    this.say(text);
    get("progress").firstElementChild.style.transform = `scaleX(${now.status === "queued" ? 0 : now.fraction ?? 0})`;
  }

  say(text) {
    get("verdict").dataset.tone = "busy";
    get("verdict").textContent = text;
    if (!get("cover").classList.contains("gone")) get("cover-text").textContent = text;
  }

  async end() {
    clearTimeout(this.waiting);
    get("progress").hidden = true;
    get("cancel").hidden = true;
    const answer = await fetch(`/folds/${this.facts.id}/facts`);
    if (answer.ok) this.onDone(await answer.json());
  }

  async cancel() {
    get("cancel").disabled = true;
    this.cancelling = true;
    clearTimeout(this.waiting);
    this.say("Cancelling…");
    const answer = await fetch(`/api/folds/${this.facts.id}/cancel`, {
      method: "POST",
      headers: { Authorization: `Bearer ${this.token}` },
    });
    // Where others wait for the same fold it goes on, and so does the telling of it.
    setTimeout(() => { this.cancelling = false; }, answer.ok ? CANCEL_MS : 0);
    if (!answer.ok) {
      get("cancel").disabled = false;
      this.toast("It could not be cancelled");
    }
  }
}
