// The animated fold on the landing page: it plays until a visitor drags its slider.
import { get } from "../lib/text.js";
import { USUAL_COLOURING } from "./colours.js";
import { playerIn } from "./player.js";

const SPEED = 1.6;
/** @type {Record<string, number>} change of the slider by each key, in percent */
const KEY_STEPS = {
  ArrowRight: 2,
  ArrowUp: 2,
  ArrowLeft: -2,
  ArrowDown: -2,
  PageUp: 10,
  PageDown: -10,
};

// Play the timeline whose address `hero` names on its canvas.
/**
 * @param {HTMLElement} hero
 * @param {HTMLCanvasElement} canvas
 * @param {{ calm: boolean }} visitor
 */
export function playHero(hero, canvas, { calm }) {
  const player = playerIn(hero, canvas, USUAL_COLOURING);
  // Motion that starts by itself needs a way to stop it (WCAG 2.2.2).
  const button = get("hero-pause");
  const slider = get("hero-folded");
  const hint = get("hero-hint");
  let dragged = false; // the slider then leads, and the chain follows it
  const tellShare = () => {
    const text = `${Math.round(Number(slider.value))} %`;
    slider.style.setProperty("--share", `${slider.value}%`);
    if (get("hero-percent").textContent === text) return;
    get("hero-percent").textContent = text;
    slider.setAttribute("aria-valuetext", text);
  };
  const run = (/** @type {boolean} */ playing) => {
    player.send({ do: "set", turn: playing && !calm });
    player.send({ do: playing ? "play" : "pause" });
  };
  player.on("begun", () => {
    button.disabled = slider.disabled = hint.hidden = false;
    player.send({ do: "set", loop: true, speed: SPEED });
    if (!calm) run(true);
  });
  player.on("state", (/** @type {State} */ { playing, folded }) => {
    button.setAttribute("aria-label", playing ? "Pause the animation" : "Play the animation");
    button.classList.toggle("playing", playing);
    if (playing) dragged = false;
    if (dragged || folded === null) return;
    slider.value = String(100 * folded);
    tellShare();
  });
  button.onclick = () => run(!player.is.playing);
  slider.oninput = () => {
    dragged = hint.hidden = true;
    tellShare();
    run(false);
    player.send({ do: "fold", percent: Number(slider.value) });
  };
  slider.onkeydown = (event) => {
    const by = KEY_STEPS[event.key];
    if (by === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    slider.value = String(Number(slider.value) + by);
    slider.dispatchEvent(new Event("input"));
  };
  window.foldback = { timeline: player.timeline, player }; // for the console
  return player;
}
