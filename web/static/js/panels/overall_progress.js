// Overall progress of a fold, combined over attempts
// and robots so that it never decreases within a stage.
import { STAGES, duration } from "../lib/text.js";

const SMOOTHING = "smoothing"; // message of that state, defined in server/schemas.py
const MARGINS = "verified; computing the margins"; // defined in planner/progress.py
const FEW_S = 5;
const ORDER = Object.keys(STAGES);

export class OverallProgress {
  stage = "";
  attempt = 1;
  plans = 0; // approximate number of plans; 0 if unknown
  smoothing = false; // true if the stage smooths a motion instead of exploding
  verified = false; // true if the verdict is certain and margins are computed
  fraction = 0; // largest fraction of the stage in this attempt
  simulatedS = 0; // seconds simulated by the most advanced robot

  // Record a report of the service; a return to an earlier stage means another attempt.
  /** @param {Api.Progress} now */
  note({ stage, fraction, simulated_s: simulatedS, message, plan, plans }) {
    if (stage && stage !== this.stage) {
      if (ORDER.indexOf(stage) < ORDER.indexOf(this.stage)) this.attempt += 1;
      Object.assign(this, { stage, fraction: 0, simulatedS: 0, smoothing: false, verified: false });
    }
    this.smoothing ||= message === SMOOTHING;
    this.verified ||= message === MARGINS;
    if (plan && plans) Object.assign(this, { attempt: plan, plans: Math.max(plan, plans) });
    this.fraction = Math.max(this.fraction, fraction ?? 0);
    this.simulatedS = Math.max(this.simulatedS, simulatedS ?? 0);
  }

  // Return the words for the attempt; none for the first.
  words() {
    if (this.plans > 1) return ` · plan ${this.attempt} of about ${this.plans}`;
    return this.attempt > 1 ? ` · attempt ${this.attempt}` : "";
  }

  // True in the last stage, whose progress is not measured.
  get writing() {
    return this.stage === ORDER.at(-1);
  }

  // Return the name of the stage.
  name() {
    return this.smoothing ? "Smoothing" : (STAGES[this.stage] ?? "Waiting");
  }

  // Return the name of the stage and its progress.
  label() {
    if (this.verified) return "✓ Verified, computing the margins …";
    // A full first stage would look like a step back when the next one begins.
    return this.writing || (this.stage === ORDER[0] && this.fraction >= 1)
      ? `${this.name()} …`
      : `${this.name()} ${Math.floor(100 * this.fraction)} %`;
  }
}

// Return the reason why a fold waits, without naming other folds.
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

// Return the remaining time, as estimated by the service, as text.
/**
 * @param {number} value in seconds; 0 if it takes longer than usual
 * @param {boolean} busy true if the computer has other work
 */
export function remaining(value, busy = false) {
  if (value <= 0)
    return busy ? "slow, because the computer is busy with other work" : "takes longer than usual";
  return value < FEW_S
    ? "a few seconds left"
    : `${duration(value < 20 ? value : 5 * Math.round(value / 5))} left`;
}
