// Plan check: a worker in this browser checks the
// motion, and the page shows its progress and outcome.
import { at as hrefOf, get, number, integerText } from "../lib/text.js";

/** @typedef {import("../check/worker.js").Asked} Asked */
/** @typedef {import("../check/worker.js").Progress} Progress */
/** @typedef {import("../check/worker.js").Proved} Proved */
/** @typedef {import("../check/worker.js").Refused} Refused */
/** @typedef {import("../check/plan.js").Place} Place */

const TOUCHING = 1e-3; // pitches; smaller gaps are not displayed
const FULL = 1 - 1e-4; // pitches; larger modules count as filling their cells

// Return a fraction of the spacing as a percentage, rounded down.
/** @param {number} share */
const percent = (share) => `${(Math.floor(1000 * share) / 10).toFixed(1)} %`;
/** @param {Place} place */
const pair = ({ modules: [i, j] }) => `modules ${integerText(i + 1)} and ${integerText(j + 1)}`;
/** @param {number} seconds */
const took = (seconds) => `${seconds < 9.95 ? number(seconds) : integerText(seconds)} s`;

// Return the outcome of a check as text.
/**
 * @param {Asked["way"]} way
 * @param {Proved | Refused} answer
 */
export function outcome(way, answer) {
  if (answer.is === "refused") return refusal(way, answer);
  const {
    plan: { modules, size, claim },
    said: { limits, standard, module, exempt, start, end },
    touch,
    joint,
    seconds,
  } = answer;
  if (way === "claim") {
    const shape = standard
      ? `Each module (${module}) fills ${percent(size)} of the spacing.`
      : `Each module, at ${percent(size)} of its full size, is ${module}.`;
    return (
      `${limits ? `Proved, but ${limits}. ` : ""}This browser checked ` +
      `${integerText(modules)} modules without our server. ${shape} The motion begins ` +
      `${start}. It ends ${end}. ${exempt ? "Modules that share no joint" : "All modules"} stay ` +
      `at least ${percent(claim)} of the spacing apart during the whole motion. The check took ` +
      `${took(seconds)}.`
    );
  }
  if (way === "size") {
    if (!touch || touch.size > FULL)
      return (
        `In this plan, each module fills ${percent(size)} of the spacing. Even modules that ` +
        `fill their cells completely would not overlap during the motion.`
      );
    return (
      `The modules may grow from ${percent(size)} to almost ${percentUp(touch.size)} of the ` +
      `spacing; then ${pair(touch)} touch.`
    );
  }
  return (
    `If the joint between modules ${integerText(joint + 1)} and ` +
    `${integerText(joint + 2)} is off by 1°, no modules touch.`
  );
}

// Return the size at which modules touch as a percentage,
// rounded up: the proof holds slightly below that size.
/** @param {number} share */
const percentUp = (share) => `${(Math.ceil(10000 * share) / 100).toFixed(2)} %`;

/**
 * @param {Asked["way"]} way
 * @param {Refused} said
 */
function refusal(way, { text, place, claim, joint }) {
  if (place && place.gap >= claim)
    return `Not proved: ${pair(place)} may be far enough apart, but the check cannot prove it.`;
  if (way === "hinge" && place)
    return (
      `If the joint between modules ${integerText(joint + 1)} and ` +
      `${integerText(joint + 2)} is off by 1°, ${pair(place)} touch.`
    );
  if (!place) return `Not proved: ${text}`;
  return (
    `Not proved: ${pair(place)} are only ${percent(Math.max(place.gap, 0))} of the spacing ` +
    `apart.`
  );
}

/** @param {string} id of a fold */
export const planOf = (id) => hrefOf(`/api/folds/${id}/plan.npz`);

export class Checking {
  static worker = () =>
    new Worker(new URL("../check/worker.js", import.meta.url), { type: "module" });

  /**
   * @param {import("../player/player.js").Player} player
   * @param {string} href of the plan
   * @param {(frame: number) => void} [seek] shows a frame of the player's timeline
   */
  constructor(
    player,
    href,
    seek = (frame) => {
      player.send({ do: "seek", frame });
    },
  ) {
    this.player = player;
    this.seek = seek;
    this.href = href;
    this.onGo = () => {};
    /** @type {Worker | null} */
    this.worker = null;
    /** @type {{ at: Place, frames: number } | null} */
    this.place = null;
    get("check-where").onclick = () => this.go();
    get("check-stop").onclick = () => this.end();
    get("check-size").onclick = () => this.begin("size");
    get("check-hinge").onclick = () => this.begin("hinge");
    for (const part of /** @type {const} */ (["check-where", "check-limits", "check-tries"]))
      get(part).hidden = true;
  }

  /** @param {Asked["way"]} way */
  begin(way) {
    this.end();
    get("check-said").textContent = "";
    get("check-running").hidden = false;
    this.reveal();
    get("check-bar").value = 0;
    this.worker = Checking.worker();
    this.worker.onmessage = (/** @type {MessageEvent<Progress | Proved | Refused>} */ { data }) =>
      this.heard(way, data);
    this.worker.onerror = () => {
      this.end();
      get("check-said").textContent = "This browser cannot run the check. Try another browser.";
    };
    this.worker.postMessage({
      href: new URL(this.href, location.href).href,
      way,
      module: this.player.selected,
    });
  }

  // Scroll just far enough to show the check.
  reveal() {
    get("checking").scrollIntoView({
      block: "nearest",
      behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "instant" : "smooth",
    });
  }

  end() {
    this.worker?.terminate();
    this.worker = null;
    get("check-running").hidden = true;
  }

  /**
   * @param {Asked["way"]} way
   * @param {Progress | Proved | Refused} message
   */
  heard(way, message) {
    if (message.is === "progress") {
      get("check-bar").value = message.frame / message.frames;
      if (message.tightest) this.show(message.tightest, message.frames, "Tightest place so far");
      return;
    }
    this.end();
    get("check-said").textContent = outcome(way, message);
    get("check-said").dataset.outcome = message.is;
    get("check-said").dataset.seconds = message.is === "proved" ? String(message.seconds) : "";
    get("check-said").className = message.is === "proved" && !message.said.limits ? "" : "bad";
    const at = message.is === "refused" ? message.place : (message.touch ?? message.tightest);
    get("check-where").hidden = !at;
    if (at)
      this.show(
        at,
        message.is === "refused" ? message.frames : message.plan.frames,
        message.is === "refused" || message.touch ? "Show where" : "Tightest place",
      );
    get("check-limits").hidden = get("check-tries").hidden = false;
    this.reveal();
  }

  /**
   * @param {Place} at
   * @param {number} frames
   * @param {string} label
   */
  show(at, frames, label) {
    this.place = { at, frames };
    get("check-where").hidden = false;
    get("check-where").textContent =
      `${label}: ${pair(at)}${at.gap < TOUCHING ? "" : `, ${percent(at.gap)} apart`}`;
  }

  // Show the reported frame and modules. The frames of the plan are the last ones of the timeline.
  go() {
    const { player, place } = this;
    const frames = player.timeline.outline?.frames;
    if (!place || !frames) return;
    this.seek(frames - place.frames + place.at.frame);
    player.mark(place.at.modules);
    player.lookAt(place.at.modules);
    this.onGo();
  }
}

// Run the check in a dialog, on pages without a drawer. The dialog closes when a place is shown.
/**
 * @param {import("../player/player.js").Player} player
 * @param {{ id: string, name: string }} fold
 * @param {(frame: number) => void} [seek]
 */
export function checkInDialog(player, { id, name }, seek) {
  const dialog = get("check-dialog");
  get("check-title").textContent = `Check ${name}`;
  const checking = new Checking(player, planOf(id), seek);
  checking.onGo = () => dialog.close();
  dialog.onclose = () => checking.end();
  dialog.showModal();
  checking.begin("claim");
}
