// Menu of the sides from which a fold can be seen.
import { get } from "../lib/text.js";

const QUARTER = Math.PI / 2;

/** @type {Record<string, [azimuth: number, elevation: number]>} */
const SIDES = { front: [-QUARTER, 0], right: [0, 0], back: [QUARTER, 0], left: [Math.PI, 0], top: [-QUARTER, QUARTER], below: [-QUARTER, -QUARTER] };

/** @param {Pick<Playing, "send">} player */
export function offerSides(player) {
  const menu = get("sides");
  menu.onchange = () => {
    const side = SIDES[menu.value];
    const camera = side ? { azimuth: side[0], elevation: side[1], zoom: 1, aside: null } : null;
    menu.value = "";
    player.send({ do: "camera", camera, gently: true });
  };
}
