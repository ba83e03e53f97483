// Overall progress of a fold, which never runs backwards: attempts and several robots are combined.
import { STAGES } from "../lib/text.js";

const SMOOTHING = "smoothing"; // the message then, as server/api/schemas.py says
const ORDER = Object.keys(STAGES);

export class OverallProgress {
  stage = "";
  attempt = 1;
  plans = 0; // about how many there are; 0 where that is not known
  smoothing = false; // in place of an explosion
  fraction = 0; // largest fraction of the stage in this attempt
  simulatedS = 0; // seconds simulated by the robot that is farthest

  // Note what the service reports; an earlier stage begins another attempt.
  /** @param {Api.Progress} now */
  note({ stage, fraction, simulated_s: simulatedS, message, plan, plans }) {
    if (stage && stage !== this.stage) {
      if (ORDER.indexOf(stage) < ORDER.indexOf(this.stage)) this.attempt += 1;
      Object.assign(this, { stage, fraction: 0, simulatedS: 0, smoothing: false });
    }
    this.smoothing ||= message === SMOOTHING;
    if (plan && plans) Object.assign(this, { attempt: plan, plans: Math.max(plan, plans) });
    this.fraction = Math.max(this.fraction, fraction ?? 0);
    this.simulatedS = Math.max(this.simulatedS, simulatedS ?? 0);
  }

  // Return the words for the attempt; none for the first.
  words() {
    if (this.plans > 1) return ` · plan ${this.attempt} of about ${this.plans}`;
    return this.attempt > 1 ? ` · attempt ${this.attempt}` : "";
  }

  // Return the name of the stage.
  name() { return this.smoothing ? "Smoothing" : STAGES[this.stage] ?? "Waiting"; }
}

// Return the reason why a fold waits, without names of other folds.
/**
 * @param {number} place in the queue, 1 for the next
 * @param {number} running folds that are computed now
 */
export function queueWords(place, running = 0) {
  const ahead = place - 1 + running;
  if (place < 1) return "In the queue";
  if (place === 1 && running === 1) return "Next in line, after the running fold";
  if (place === 1 && running) return `Next in line, after one of the ${running} running folds`;
  return ahead ? `In the queue, behind ${ahead} other fold${ahead > 1 ? "s" : ""}` : "Next in line";
}
