// The animated fold on the landing page.
import { get } from "../lib/text.js";
import { playerIn } from "./player.js";

const SPEED = 1.6;

// Play the timeline whose address `hero` names on its canvas.
/**
 * @param {HTMLElement} hero
 * @param {HTMLCanvasElement} canvas
 * @param {{ calm: boolean }} visitor
 */
export function playHero(hero, canvas, { calm }) {
  const player = playerIn(hero, canvas);
  player.on("begun", () => {
    player.send({ do: "set", loop: true, speed: SPEED, turn: !calm });
    if (!calm) player.send({ do: "play" });
  });
  // Motion that starts by itself needs a way to stop it (WCAG 2.2.2).
  const button = get("hero-pause");
  player.on("state", (/** @type {State} */ { playing }) => {
    button.hidden = false;
    button.setAttribute("aria-label", playing ? "Pause the animation" : "Play the animation");
    button.classList.toggle("playing", playing);
  });
  button.onclick = () => {
    const playing = !player.is.playing;
    player.send({ do: "set", turn: playing && !calm });
    player.send({ do: playing ? "play" : "pause" });
  };
  window.foldback = { timeline: player.timeline, player }; // for the console
  return player;
}
