// Deliberate faults in a plan: modules enlarged until some touch, or a hinge that is off.
import { Module } from "./module.js";
import { NotProved } from "./plan.js";
import { Proof } from "./proof.js";

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Place} Place */

const SHY = 1e-4; // margin below the size at which modules touch
const OFF = Math.PI / 180;

/**
 * Finds the largest module size: it starts at the size
 * of the cells and shrinks wherever modules touch.
 */
export class Largest {
  /**
   * @type {(Place & { size: number }) | null} pair of modules that reduced the size last, and the
   *   size at which they touch
   */
  touch = null;

  /** @param {Plan} plan */
  constructor(plan) {
    this.proof = new Proof(plan, 1);
  }

  /** Prove all intervals, as `Proof.run` does. */
  *run() {
    const { proof } = this;
    for (let k = 0; k < proof.intervals; k++) {
      yield k;
      try {
        proof.interval(k);
      } catch (error) {
        const place = error instanceof NotProved ? error.place : null,
          size = Math.min(place?.fits ?? 0, proof.size);
        if (!place || size <= SHY) throw error;
        this.touch = { ...place, size };
        proof.size = size - SHY;
        proof.module = new Module(proof.plan.module.geometry, proof.size);
        k--; // once more, with smaller modules
      }
    }
  }
}

/**
 * Turn a hinge one degree away from its folded angle, in all
 * frames but the first and the last. Return the joint's number.
 * @param {Plan} plan
 * @param {number} module
 */
export function turnMore(plan, module) {
  const {
    hinges,
    geometry: { rigid_links: rigid },
  } = plan.module;
  const joint = Math.min(Math.max(module, rigid), plan.n - 2);
  const slots = Array.from({ length: hinges }, (_, h) => (joint - rigid) * hinges + h);
  const slot = slots.reduce((a, b) =>
    Math.abs(plan.folded[b]) > Math.abs(plan.folded[a]) ? b : a,
  );
  for (let k = 1; k < plan.frames - 1; k++) {
    if (slot >= plan.first[k] && slot < plan.last[k])
      plan.values[plan.offsets[k] + slot - plan.first[k]] -=
        Math.sign(plan.folded[slot] || 1) * OFF;
  }
  plan.maxAngle += OFF;
  plan.step = Infinity;
  return joint;
}
