// Check the plans whose paths are read line by line, as the worker of a page does, and print each result as a line of
// JSON.
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { NotProved, Plan } from "../../../web/static/js/check/plan.js";
import { Proof } from "../../../web/static/js/check/proof.js";
import { Largest } from "../../../web/static/js/check/spoil.js";

// Count pairs and bounds of an interval, and those bounds without the allowance for interpolation and rounding.
class Watched extends Proof {
  pairs = 0;
  bounds = 0;
  above = 0;
  least = Infinity;

  solids(lost) {
    this.seen = -Infinity;
    const bound = super.solids(lost);
    this.pairs++;
    this.bounds += Number(Number.isFinite(bound));
    this.above += Number(bound > this.seen - lost);
    if (bound >= this.plan.claim) this.least = Math.min(this.least, bound);
    return bound;
  }

  during(one, other) {
    const found = super.during(one, other);
    this.seen = Math.max(this.seen, found);
    return found;
  }
}

async function verdict(path) {
  try {
    const proof = new Watched(await Plan.read(new Uint8Array(readFileSync(path))));
    const frames = [...proof.run()];
    const said = proof.plan.words(proof.largest);
    return { proved: said.verdict === "proved", ...said, claim: proof.plan.claim, least: proof.least, tightest: proof.tightest, pairs: proof.pairs, bounds: proof.bounds, above: proof.above, frames: frames.length };
  } catch (error) {
    if (!(error instanceof NotProved)) throw error;
    return { proved: false, verdict: error.verdict, text: error.message, place: error.place };
  }
}

async function largest(path) {
  const plan = await Plan.read(new Uint8Array(readFileSync(path)));
  plan.claim = 1e-5;
  const found = new Largest(plan), frames = [...found.run()];
  return { size: found.proof.size, touch: found.touch, frames: frames.length };
}

async function rounding(path) {
  return { rounding: new Proof(await Plan.read(new Uint8Array(readFileSync(path)))).E };
}

const check = { size: largest, claim: verdict, rounding }[process.argv[2]];
for await (const path of createInterface({ input: process.stdin })) console.log(JSON.stringify(await check(path)));
