// Checks the plans whose paths come in line by line, as the worker of a page does, and prints what came out of each as a
// line of JSON.
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { NotProved, Plan } from "../../../web/static/js/check/plan.js";
import { Proof } from "../../../web/static/js/check/proof.js";

// Counts bounds of an interval, and those from which it is not taken off what interpolation and rounding may hide.
class Watched extends Proof {
  bounds = 0;
  above = 0;

  solids(i, j, at, to, lost) {
    this.seen = -Infinity;
    const bound = super.solids(i, j, at, to, lost);
    this.bounds += Number(Number.isFinite(bound));
    this.above += Number(bound > this.seen - lost);
    return bound;
  }

  during(at, to) {
    const found = super.during(at, to);
    this.seen = Math.max(this.seen, found);
    return found;
  }
}

async function verdict(path) {
  try {
    const proof = new Watched(await Plan.read(new Uint8Array(readFileSync(path))));
    const frames = [...proof.run()];
    return { proved: true, claim: proof.claim, least: proof.least, tightest: proof.tightest, pairs: proof.pairs, bounds: proof.bounds, above: proof.above, frames: frames.length };
  } catch (error) {
    if (!(error instanceof NotProved)) throw error;
    return { proved: false, text: error.message, place: error.place };
  }
}

async function largest(path) {
  const proof = new Proof(await Plan.read(new Uint8Array(readFileSync(path))), { claim: 1e-5, size: 1, grow: true });
  const frames = [...proof.run()];
  return { size: proof.size, touch: proof.touch, frames: frames.length };
}

const check = process.argv[2] === "size" ? largest : verdict;
for await (const path of createInterface({ input: process.stdin })) console.log(JSON.stringify(await check(path)));
