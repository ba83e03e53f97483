// Checks a plan in a thread of its own, as it is or broken on purpose, and tells how far it is.
import { NotProved, Plan } from "./plan.js";
import { Proof } from "./proof.js";

/** @typedef {import("./plan.js").Place} Place */
/**
 * What to check: a plan as it claims to be, how large its modules may be, or what a hinge does that is off.
 * @typedef {{ href: string, way: "claim" | "size" | "hinge", module: number | null }} Asked
 * @typedef {{ frames: number, modules: number, size: number, claim: number }} Claimed
 * @typedef {{ is: "progress", frame: number, frames: number, tightest: Place | null }} Progress
 * @typedef {{ is: "proved", plan: Claimed, size: number, tightest: Place | null, touch: (Place & { size: number }) | null, joint: number, seconds: number }} Proved
 * @typedef {{ is: "refused", text: string, place: Place | null, frames: number, claim: number, joint: number }} Refused
 */

const TELL_MS = 60;
const TOUCHES = 1e-5; // widths of a cell: modules that are nearer touch
const OFF = Math.PI / 180;

/**
 * Turns a hinge a little further than the plan does, in all frames but the first and the last; gives the joint's number.
 * @param {Plan} plan
 * @param {number} module
 */
function turn(plan, module) {
  const { hinges, told: { rigid_links: rigid } } = plan.module;
  const joint = Math.min(Math.max(module, rigid), plan.n - 2);
  const some = Array.from({ length: hinges }, (_, h) => (joint - rigid) * hinges + h);
  const slot = some.reduce((a, b) => (Math.abs(plan.folded[b]) > Math.abs(plan.folded[a]) ? b : a));
  for (let k = 1; k < plan.frames - 1; k++) {
    if (slot >= plan.first[k] && slot < plan.last[k]) plan.values[plan.offsets[k] + slot - plan.first[k]] -= Math.sign(plan.folded[slot] || 1) * OFF;
  }
  plan.most += OFF;
  plan.step = Infinity;
  return joint;
}

/** @param {Asked} asked */
async function check({ href, way, module }) {
  const began = performance.now();
  let frames = 0, joint = 0, claim = 0, told = 0;
  try {
    const answer = await fetch(href);
    if (!answer.ok) throw new NotProved("The plan file cannot be loaded.");
    const plan = await Plan.read(new Uint8Array(await answer.arrayBuffer())), { n: modules, size } = plan;
    if (way !== "claim") plan.claim = TOUCHES;
    if (way === "hinge") joint = turn(plan, module ?? Math.floor(Math.random() * plan.n));
    ({ frames, claim } = plan);
    const proof = new Proof(plan, way === "size");
    for (const frame of proof.run()) {
      if (performance.now() - told < TELL_MS) continue;
      told = performance.now();
      postMessage({ is: "progress", frame, frames, tightest: proof.tightest });
    }
    const { tightest, touch, size: found } = proof, seconds = (performance.now() - began) / 1000;
    postMessage({ is: "proved", plan: { frames, modules, size, claim }, size: found, tightest, touch, joint, seconds });
  } catch (error) {
    const { message: text, place = null } = /** @type {Error & { place?: Place | null }} */ (error);
    postMessage({ is: "refused", text, place, frames, claim, joint });
  }
}

onmessage = (/** @type {MessageEvent<Asked>} */ { data }) => { check(data); };
