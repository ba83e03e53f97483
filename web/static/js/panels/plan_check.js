// Plan check: a worker of this browser goes through the motion, and the page says how far it is and what came out.
import { at as hrefOf, button, element, number, svg, whole } from "../lib/text.js";

/** @typedef {import("../check/worker.js").Asked} Asked */
/** @typedef {import("../check/worker.js").Progress} Progress */
/** @typedef {import("../check/worker.js").Proved} Proved */
/** @typedef {import("../check/worker.js").Refused} Refused */
/** @typedef {import("../check/plan.js").Place} Place */

const NOT_CLAIMED = [
  "Real joints are slightly loose, and real modules bend. The check assumes rigid modules and exact hinges.",
  "The check does not compare modules that share a joint. They overlap at the joint by design.",
  "Only a few robots were simulated. Other robots may behave differently.",
];

const TOUCHING = 1e-3; // widths of a cell that are not worth a number
const FULL = 1 - 1e-4; // cells' widths: larger modules fill theirs

// Widths of a cell as a percentage, rounded down.
/** @param {number} share */
const percent = (share) => `${(Math.floor(1000 * share) / 10).toFixed(1)} %`;
/** @param {Place} place */
const pair = ({ modules: [i, j] }) => `modules ${whole(i + 1)} and ${whole(j + 1)}`;
/** @param {number} seconds */
const took = (seconds) => `${seconds < 9.95 ? number(seconds) : whole(seconds)} s`;

// What came out of a check, in words.
/**
 * @param {Asked["way"]} way
 * @param {Proved | Refused} said
 */
export function outcome(way, said) {
  if (said.is === "refused") return refusal(way, said);
  const { plan: { modules, size, claim }, touch, joint, seconds } = said;
  if (way === "claim") {
    return `This browser checked ${whole(modules)} modules without our server. Modules that share no joint stay at least ${percent(claim)} of a module width apart during the whole motion. The check took ${took(seconds)}.`;
  }
  if (way === "size") {
    if (!touch || touch.size > FULL) return `In this plan, the modules are ${percent(size)} as wide as their cells. Even if they were exactly as wide, they would not overlap during the motion.`;
    return `In this plan, the modules are ${percent(size)} as wide as their cells. At a width of ${percentUp(touch.size)}, ${pair(touch)} would touch. At a slightly smaller width, none would.`;
  }
  return `If the joint between modules ${whole(joint + 1)} and ${whole(joint + 2)} is off by 1°, no modules touch.`;
}

// The size at which modules touch is rounded up: a little below it they are proved not to.
/** @param {number} share */
const percentUp = (share) => `${(Math.ceil(10000 * share) / 100).toFixed(2)} %`;

/**
 * @param {Asked["way"]} way
 * @param {Refused} said
 */
function refusal(way, { text, place, claim, joint }) {
  if (place && place.gap >= claim) return `Not proved: the check cannot tell whether ${pair(place)} are far enough apart.`;
  if (way === "hinge" && place) return `If the joint between modules ${whole(joint + 1)} and ${whole(joint + 2)} is off by 1°, ${pair(place)} touch.`;
  if (!place) return `Not proved: ${text}`;
  return `Not proved: ${pair(place)} come within ${percent(Math.max(place.gap, 0))} of a module width of each other.`;
}

/** @param {string} id of a fold */
export const planOf = (id) => hrefOf(`/api/folds/${id}/plan.npz`);

export class Checking {
  static worker = () => new Worker(new URL("../check/worker.js", import.meta.url), { type: "module" });

  /**
   * @param {HTMLElement} place
   * @param {import("../player/player.js").Player} player
   * @param {string} href of the plan
   * @param {(frame: number) => void} [seek] shows a frame of its timeline
   */
  constructor(place, player, href, seek = (frame) => { player.send({ do: "seek", frame }); }) {
    this.player = player;
    this.seek = seek;
    this.href = href;
    this.onGo = () => {};
    /** @type {Worker | null} */
    this.worker = null;
    this.bar = element("progress", { max: "1", value: "0", "aria-label": "Progress of the check" });
    this.line = element("p", { role: "status" });
    this.where = button("inline", "", () => this.go());
    this.stop = button("button quiet", "Stop", () => this.end());
    this.running = element("div", { class: "checking", hidden: true }, this.bar, this.stop);
    /** @type {{ at: Place, frames: number } | null} */
    this.seen = null;
    this.tries = element("div", { hidden: true }, element("h4", {}, "Try to break it"),
      element("p", { class: "line" }, button("button", "Larger modules", () => this.begin("size")), button("button", "Turn a hinge by 1°", () => this.begin("hinge"))),
      element("p", { class: "hint" }, "Make all modules larger until two of them touch, or keep one hinge 1° away from its planned angle. To choose the hinge, select its module. If no module is selected, the hinge is chosen at random."));
    this.open = element("details", { class: "assumptions", hidden: true }, element("summary", {}, "What this check does not show"), element("ul", {}, ...NOT_CLAIMED.map((said) => element("li", {}, said))));
    this.all = element("div", {}, this.running, this.line, element("p", {}, this.where), this.open, this.tries);
    place.append(this.all);
    this.where.hidden = true;
  }

  /** @param {Asked["way"]} way */
  begin(way) {
    this.end();
    this.line.textContent = "";
    this.running.hidden = false;
    this.reveal();
    this.bar.value = 0;
    this.worker = Checking.worker();
    this.worker.onmessage = (/** @type {MessageEvent<Progress | Proved | Refused>} */ { data }) => this.heard(way, data);
    this.worker.onerror = () => { this.end(); this.line.textContent = "This browser cannot run the check. Try another browser."; };
    this.worker.postMessage({ href: new URL(this.href, location.href).href, way, module: this.player.selected });
  }

  // Scrolls no further than it takes to show all, or where that is too much, its beginning.
  reveal() {
    this.all.scrollIntoView({ block: "nearest", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "instant" : "smooth" });
  }

  end() {
    this.worker?.terminate();
    this.worker = null;
    this.running.hidden = true;
  }

  /**
   * @param {Asked["way"]} way
   * @param {Progress | Proved | Refused} said
   */
  heard(way, said) {
    if (said.is === "progress") {
      this.bar.value = said.frame / said.frames;
      if (said.tightest) this.show(said.tightest, said.frames, "Tightest place so far");
      return;
    }
    this.end();
    this.line.textContent = outcome(way, said);
    this.line.className = said.is === "proved" ? "" : "bad";
    const at = said.is === "refused" ? said.place : said.touch ?? said.tightest;
    this.where.hidden = !at;
    if (at) this.show(at, said.is === "refused" ? said.frames : said.plan.frames, said.is === "refused" || said.touch ? "Show where" : "Tightest place");
    this.open.hidden = this.tries.hidden = false;
    this.reveal();
  }

  /**
   * @param {Place} at
   * @param {number} frames
   * @param {string} label
   */
  show(at, frames, label) {
    this.seen = { at, frames };
    this.where.hidden = false;
    this.where.textContent = `${label}: ${pair(at)}${at.gap < TOUCHING ? "" : `, ${percent(at.gap)} apart`}`;
  }

  // To the frame and the modules that are told; the plan's frames are the timeline's last.
  go() {
    const { player, seen } = this;
    const frames = player.timeline.outline?.frames;
    if (!seen || !frames) return;
    this.seek(frames - seen.frames + seen.at.frame);
    player.mark(seen.at.modules);
    player.lookAt(seen.at.modules);
    this.onGo();
  }
}

// The same in a dialog, on pages without details; it closes when it leads to a place.
/**
 * @param {import("../player/player.js").Player} player
 * @param {{ id: string, name: string }} fold
 * @param {(frame: number) => void} [seek]
 */
export function checkInDialog(player, { id, name }, seek) {
  const place = element("div", { id: "check" });
  const close = button("icon-button dialog-close", "", () => dialog.close(), { "aria-label": "Close", title: "Close" });
  close.append(svg("svg", { class: "icon" }, svg("use", { href: "#i-close" })));
  const dialog = element("dialog", { class: "dialog", "aria-labelledby": "check-title" }, close, element("h2", { id: "check-title" }, `Check ${name}`), place);
  const checking = new Checking(place, player, planOf(id), seek);
  checking.onGo = () => dialog.close();
  dialog.onclose = () => { checking.end(); dialog.remove(); };
  document.body.append(dialog);
  dialog.showModal();
  checking.begin("claim");
}
