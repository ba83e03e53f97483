// Checks a plan in a separate thread, unchanged or
// with a deliberate fault, and reports the progress.
import { NotProved, Plan } from "./plan.js";
import { Proof } from "./proof.js";
import { Largest, turnMore } from "./spoil.js";

/** @typedef {import("./plan.js").Place} Place */
/** @typedef {import("./plan.js").Said} Said */
/**
 * `way` is the check: the plan's claim, the largest size
 * of its modules, or the effect of a hinge that is off.
 * @typedef {{ href: string, way: "claim" | "size" | "hinge", module: number | null }} Asked
 * @typedef {{ frames: number, modules: number, size: number, claim: number }} Claimed
 * @typedef {{ is: "progress", frame: number, frames: number, tightest: Place | null }} Progress
 * @typedef {{ is: "proved", plan: Claimed, said: Said, size: number, tightest: Place | null,
 *   touch: (Place & { size: number }) | null, joint: number, seconds: number }} Proved
 * @typedef {{ is: "refused", text: string, place: Place | null, frames: number, claim: number,
 *   joint: number }} Refused
 */

const TELL_MS = 60;
const TOUCHES = 1e-5; // cell widths; modules that are nearer touch

/** @param {Asked} asked */
async function check({ href, way, module }) {
  const began = performance.now();
  let frames = 0,
    joint = 0,
    claim = 0,
    reportedMs = 0;
  try {
    const answer = await fetch(href);
    if (!answer.ok)
      throw new NotProved("The plan file cannot be loaded. Check the connection and try again.");
    const plan = await Plan.read(new Uint8Array(await answer.arrayBuffer())),
      { n: modules, size } = plan;
    if (way !== "claim") plan.claim = TOUCHES;
    if (way === "hinge") joint = turnMore(plan, module ?? Math.floor(Math.random() * plan.n));
    ({ frames, claim } = plan);
    const largest = way === "size" ? new Largest(plan) : null,
      proof = largest?.proof ?? new Proof(plan);
    for (const frame of (largest ?? proof).run()) {
      if (performance.now() - reportedMs < TELL_MS) continue;
      reportedMs = performance.now();
      postMessage({ is: "progress", frame, frames, tightest: proof.tightest });
    }
    const { tightest, size: moduleSize } = proof,
      touch = largest?.touch ?? null,
      seconds = (performance.now() - began) / 1000;
    postMessage({
      is: "proved",
      plan: { frames, modules, size, claim },
      said: plan.words(proof.largest),
      size: moduleSize,
      tightest,
      touch,
      joint,
      seconds,
    });
  } catch (error) {
    const { message: text, place = null } = /** @type {Error & { place?: Place | null }} */ (error);
    postMessage({ is: "refused", text, place, frames, claim, joint });
  }
}

onmessage = (/** @type {MessageEvent<Asked>} */ { data }) => {
  check(data);
};
