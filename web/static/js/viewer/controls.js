// Controls of a 3D view: the menu of sides, the path button, and the colour legend.
import { get } from "../lib/text.js";
import { Player } from "../player/player.js";
import { Hand } from "./scene.js";
import { Sketch } from "./sketch.js";
import { Stage } from "./stage.js";
import { StandIn } from "./stand_in.js";

const QUARTER = Math.PI / 2;
/** @type {Record<string, [azimuth: number, elevation: number]>} */
const SIDES = {
  front: [-QUARTER, 0],
  right: [0, 0],
  back: [QUARTER, 0],
  left: [Math.PI, 0],
  top: [-QUARTER, QUARTER],
  below: [-QUARTER, -QUARTER],
};

// Create a player of a timeline on a 3D view with pointer controls, and on the fallback drawing.
/**
 * @param {import("../player/timeline.js").Timeline} timeline
 * @param {HTMLIFrameElement} frame
 * @param {HTMLCanvasElement} canvas
 * @param {{ calm: boolean, onFirst?: () => void, onScroll?: () => void, pauseMs?: () => number }}
 *   options `onFirst` is called after
 *   the first drawing, `onScroll` if the page around an embed scrolls
 */
export function playerOn(timeline, frame, canvas, { calm, onFirst, onScroll, pauseMs }) {
  const sketch = new Sketch(canvas, onFirst);
  const stage = new Stage(frame, {
    open: () => standIn.takeOver(),
    pick: (origin, direction) => player.pick(origin, direction),
    lost: () => {
      standIn.fallBack();
      player.show(true);
    },
  });
  const standIn = new StandIn(canvas, stage, sketch);
  /** @type {Player} */
  const player = new Player(timeline, {
    stage,
    standIn,
    sketch,
    aspect: () => frame.clientWidth / Math.max(1, frame.clientHeight),
    calm,
    pauseMs,
  });
  const hand = new Hand((orbit) => player.send({ do: "orbit", ...orbit }), {
    height: () => Math.max(1, frame.clientHeight),
    follows: () => player.is.follow,
    tap: (x, y) => stage.tap(x, y),
    scroll: onScroll,
  });
  hand.cover(canvas);
  new ResizeObserver(() => player.show(true)).observe(frame);
  return { player, stage, sketch, standIn, hand };
}

// Set up the menu of viewing directions.
/** @param {Pick<Playing, "send">} player */
export function offerSides(player) {
  const menu = get("sides");
  menu.onchange = () => {
    const side = SIDES[menu.value];
    const camera = side ? { azimuth: side[0], elevation: side[1], zoom: 1, offset: null } : null;
    menu.value = "";
    player.send({ do: "camera", camera, gently: true });
  };
}

// Set up the button that makes modules transparent and shows the path of the chain.
/** @param {import("./stage.js").Stage[]} stages */
export function pathButton(stages) {
  const button = get("through");
  const path = {
    on: false,
    changed: () => {},
    set(/** @type {boolean} */ on) {
      if (on === path.on) return;
      path.on = on;
      button.setAttribute("aria-pressed", String(on));
      for (const stage of stages) stage.seeThrough(on);
      path.changed();
    },
  };
  button.onclick = () => path.set(!path.on);
  return path;
}

// Show the legend of a colouring.
/**
 * @param {import("../player/colours.js").Colouring} colouring
 * @param {import("../player/timeline.js").Timeline} timeline
 */
export function showScale(colouring, timeline) {
  const { low, high, ramp, missing, none } = colouring.legend();
  get("legend").hidden = false;
  get("legend").style.setProperty(
    "--unknown",
    `rgb(${timeline.bundle.header.colours.unknown.join(" ")})`,
  );
  get("legend-low").textContent = low;
  get("legend-high").textContent = high;
  get("legend-ramp").style.background = ramp;
  get("legend-none").hidden = !none;
  get("legend-none").dataset.missing = missing;
  const meaning = get("legend-none").lastElementChild;
  if (meaning) meaning.textContent = none;
}
