// Progress of a fold that never runs backwards: attempts and several robots are combined.
const ORDER = ["read", "explode", "play_back", "certify", "export"];

export class Advance {
  constructor() {
    this.stage = "";
    this.attempt = 1;
    this.fraction = 0; // largest fraction of the stage in this attempt
    this.simulatedS = 0; // seconds simulated by the robot that is farthest
  }

  // Note what the service reports; an earlier stage begins another attempt.
  /** @param {ProgressTold} now */
  note({ stage, fraction, simulated_s: simulatedS }) {
    if (stage && stage !== this.stage) {
      if (ORDER.indexOf(stage) < ORDER.indexOf(this.stage)) this.attempt += 1;
      Object.assign(this, { stage, fraction: 0, simulatedS: 0 });
    }
    this.fraction = Math.max(this.fraction, fraction ?? 0);
    this.simulatedS = Math.max(this.simulatedS, simulatedS ?? 0);
  }

  // Return the words for the attempt; none for the first.
  words() { return this.attempt > 1 ? ` · attempt ${this.attempt}` : ""; }
}

// Return the reason why a fold waits, without names of other folds.
/** @param {number} place in the queue, 1 for the next */
export function queueWords(place) {
  const ahead = place - 1;
  if (place < 1) return "In the queue";
  return ahead ? `In the queue, behind ${ahead} other fold${ahead > 1 ? "s" : ""}` : "Next in line";
}
