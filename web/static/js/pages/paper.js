// Films in the page: one at a time is loaded and drawn.
import { PHASES } from "../player/timeline.js";
import { Pair } from "../player/paired_playback.js";
import { playerIn } from "../player/player.js";
import { element, later, radians, seconds } from "../lib/text.js";

const SPEED = 1.2;
// All folds of the paper are made by explosions.
/** @type {Record<string, string>} */
const LABELS = { ...PHASES, explosion: "Explosion", playback: "Playback" };
const sight = later(
  () => import("../viewer/viewpoint.js"),
  () => {},
);
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

/**
 * Return a part that every figure has.
 * @param {HTMLElement} figure
 * @param {string} selector
 */
const within = (figure, selector) => /** @type {HTMLElement} */ (figure.querySelector(selector));

// A figure whose stills are replaced by films until it is closed.
class Showing {
  /** @param {HTMLElement} figure */
  constructor(figure) {
    this.figure = figure;
    this.inView = true;
    this.resting = false;
    this.bar = within(figure, ".run-bar");
    this.scrub = /** @type {HTMLInputElement} */ (within(figure, ".run-scrub"));
    this.toggle = within(figure, ".run-bar button");
    this.views = /** @type {HTMLElement[]} */ ([
      ...figure.querySelectorAll(".run-view[data-timeline]"),
    ]);
    this.players = this.views.map((view) => {
      const canvas = element("canvas", {
        class: "run-sketch",
        role: "img",
        "aria-label": view.dataset.label,
      });
      view.append(canvas);
      return playerIn(view, canvas);
    });
    this.head = this.players.length > 1 ? new Pair(this.players) : this.players[0];
    /** @type {(() => void) | null} */
    this.then = null;
    this.head.on("state", (/** @type {State} */ state) => this.show(state));
    this.head.on("begun", () => {
      for (const player of this.players) player.mark(stuckAt(figure).modules);
      this.head.send({ do: "set", speed: SPEED, loop: figure.matches(".headline") });
      this.then?.();
      this.then = null;
    });
    this.scrub.oninput = () => this.head.send({ do: "seek", frame: Number(this.scrub.value) });
    this.toggle.onclick = () => this.head.send({ do: "toggle" });
    this.watch = new IntersectionObserver(([{ isIntersecting: inView }]) => this.look(inView));
    this.watch.observe(figure);
    figure.classList.add("open");
    this.bar.hidden = false;
    start(figure).hidden = true;
  }

  // Run a callback once the films are loaded.
  /** @param {() => void} then */
  when(then) {
    if (this.players.every(({ snapshot }) => snapshot)) then();
    else this.then = then;
  }

  play() {
    this.when(() => this.head.send({ do: "play" }));
  }

  where() {
    const { frame, modules } = stuckAt(this.figure);
    this.when(() => {
      this.head.send({ do: "seek", frame });
      sight(({ clearestSight }) => {
        for (const player of this.players) player.lookAt(modules, clearestSight);
      });
    });
  }

  // Pause while the figure is out of view.
  /** @param {boolean} inView */
  look(inView) {
    const { playing } = this.head.playhead.is;
    if (!inView && playing) {
      this.resting = true;
      this.head.send({ do: "pause" });
    }
    if (inView && this.resting) {
      this.resting = false;
      this.head.send({ do: "play" });
    }
  }

  /** @param {State} state */
  show({ playing, frame, frames, phase, time_s: time, error_rad: error }) {
    this.scrub.max = String(frames - 1);
    this.scrub.value = String(Math.round(frame));
    const words = [
      LABELS[phase],
      time === null ? null : seconds(time),
      error === null ? null : `joint error ${radians(error)}`,
    ];
    const caption = words.filter(Boolean).join(" · ");
    within(this.figure, ".run-now").textContent = caption;
    this.scrub.setAttribute(
      "aria-valuetext",
      `${LABELS[phase]}, frame ${Math.round(frame) + 1} of ${frames}`,
    );
    this.toggle.setAttribute("aria-label", playing ? "Pause" : "Play");
    this.toggle.querySelector("use")?.setAttribute("href", playing ? "#i-pause" : "#i-play");
  }

  close() {
    this.watch.disconnect();
    this.head.send({ do: "pause" });
    for (const { timeline, sketch } of this.players) {
      timeline.stop();
      sketch?.worker?.terminate();
      sketch?.canvas.remove();
    }
    for (const view of this.views) view.classList.remove("moving");
    this.figure.classList.remove("open");
    this.bar.hidden = true;
    start(this.figure).hidden = false;
  }
}

const start = (/** @type {HTMLElement} */ figure) => within(figure, ".run-start");

/** @param {HTMLElement} figure */
function stuckAt({ dataset: { stuckFrame, stuck } }) {
  return { frame: Number(stuckFrame ?? 0), modules: stuck ? stuck.split(" ").map(Number) : [] };
}

/** @type {Showing | null} */
let showing = null;
/** @param {HTMLElement} figure */
function opened(figure) {
  if (showing?.figure === figure) return showing;
  showing?.close();
  showing = new Showing(figure);
  // For the console.
  window.foldback = { timeline: showing.players[0].timeline, player: showing.players[0], showing };
  return showing;
}

for (const figure of /** @type {NodeListOf<HTMLElement>} */ (
  document.querySelectorAll(".run:has([data-timeline])")
)) {
  const button = start(figure);
  button.hidden = false;
  button.onclick = () => {
    opened(figure).play();
    within(figure, ".run-toggle").focus();
  };
  const whereButton = /** @type {HTMLElement | null} */ (figure.querySelector(".run-where"));
  if (!whereButton) continue;
  whereButton.hidden = false;
  whereButton.onclick = () => opened(figure).where();
}
const first = /** @type {HTMLElement | null} */ (document.querySelector("[data-plays]"));
if (first && !calm) opened(first).play();
