// The fold in motion on the first page.
import { Film, Source } from "./film.js";
import { Player } from "./player.js";
import { Sketch } from "./sketch.js";

const SPEED = 1.6;

// Plays a fold on the canvas in `hero`; null where there is none to play.
export function playHero(hero, canvas, { calm }) {
  if (!hero.dataset.fold) return null;
  const sketch = new Sketch(canvas, () => hero.classList.add("moving"));
  const player = new Player(new Film(new Source(hero.dataset.fold)), {
    sketch, aspect: () => canvas.clientWidth / Math.max(1, canvas.clientHeight),
  });
  new ResizeObserver(() => player.show(true)).observe(canvas);
  player.on("begun", () => {
    player.send({ do: "set", loop: true, speed: SPEED, turn: !calm });
    if (!calm) player.send({ do: "play" });
  });
  return player;
}
