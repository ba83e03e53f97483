// A fold in an exhibition: its tour plays in a loop. A visitor can
// take over; after some time without input the tour restarts. The page
// around it (pages/kiosk.js) receives its state: see docs/links.md.
import { get } from "../lib/text.js";

const USUAL_S = 60;
const RANGE_S = [10, 3600];
const PAUSE_MS = 3000; // before the tour restarts
const STILL_MS = 10_000; // at the folded shape, with reduced motion and without a tour
const INPUTS = ["pointerdown", "keydown", "input", "wheel"];

// Return the idle time in seconds that an address requests with `kiosk`; null without it.
/** @param {string} search */
export function idleSeconds(search) {
  const text = new URLSearchParams(search).get("kiosk");
  if (text === null) return null;
  const seconds = Number(/^\d{1,4}$/.test(text) ? text : USUAL_S);
  return seconds >= RANGE_S[0] && seconds <= RANGE_S[1] ? seconds : USUAL_S;
}

/**
 * @param {Pick<import("./panel.js").Toured, "player" | "calm"> & {
 *   touring: import("./panel.js").Touring }} shown
 */
export function exhibit({ player, calm, touring }) {
  const idleMs = 1000 * (idleSeconds(location.search) ?? USUAL_S);
  const box = get("tour-panel");
  let visitorActive = false; // true while a visitor is active
  let telling = false; // true while a fold without a tour plays
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer; // until the restart

  // Report to the page around it; the messages are not confidential.
  const tell = (/** @type {"ready" | "touched" | "over"} */ word) => {
    if (parent !== window) parent.postMessage({ kiosk: word }, "*");
  };

  async function begin() {
    clearTimeout(timer);
    visitorActive = telling = false;
    for (const dialog of document.querySelectorAll("dialog")) dialog.close();
    player.send({ do: "select", module: null });
    player.send({ do: "set", speed: 1 });
    const hasTour = await touring((panel) => {
      panel.onEnd = over;
      panel.open({ playing: true });
      return true;
    });
    tell("ready");
    if (hasTour || visitorActive) return;
    player.send({ do: "seek", frame: calm ? player.timeline.last : 0 });
    if (calm) {
      timer = setTimeout(over, STILL_MS);
      return;
    }
    player.send({ do: "play" });
    telling = true;
  }

  function over() {
    telling = false;
    if (visitorActive) return;
    tell("over");
    timer = setTimeout(begin, PAUSE_MS);
  }

  // Pause the tour after input of a visitor; restart it after the idle time.
  const touch = (/** @type {EventTarget | null} */ target) => {
    visitorActive = true;
    telling = false;
    if (!box.hidden && !(target instanceof Node && box.contains(target)))
      touring((panel) => panel.pause());
    tell("touched");
    clearTimeout(timer);
    timer = setTimeout(() => {
      visitorActive = false;
      over();
    }, idleMs);
  };

  for (const kind of INPUTS)
    addEventListener(kind, (event) => touch(event.target), { capture: true, passive: true });
  player.on("camera", (/** @type {Command} */ { do: command }) => {
    if (command === "orbit") touch(null);
  });
  player.on("state", (/** @type {State} */ { playing }) => {
    if (telling && !playing && player.playhead.frame >= player.timeline.last) over();
  });
  const drag = document.querySelector("label.folded");
  if (drag) box.prepend(drag); // the slider from straight to folded
  begin();
}
