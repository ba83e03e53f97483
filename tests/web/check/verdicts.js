// Checks the plans named after it, as the worker of a page does, and prints what came out of each as a line of JSON.
import { readFileSync } from "node:fs";
import { NotProved, Plan } from "../../../web/static/js/check/plan.js";
import { Proof } from "../../../web/static/js/check/proof.js";

async function verdict(path) {
  try {
    const proof = new Proof(await Plan.read(new Uint8Array(readFileSync(path))));
    const frames = [...proof.run()];
    return { proved: true, claim: proof.claim, least: proof.least, looks: proof.looks, pairs: proof.pairs, frames: frames.length };
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

const [way, ...paths] = process.argv.slice(2);
for (const path of paths) console.log(JSON.stringify(await (way === "size" ? largest : verdict)(path)));
