// The comparison page: two folds side by side.
import { Bar } from "../player/bar.js";
import { Keys } from "../player/keys.js";
import { COLOURINGS, MEASURED, colouringFor } from "../player/colours.js";
import { Timeline, Source } from "../player/timeline.js";
import { Place, viewOf } from "../player/address.js";
import { Pair } from "../player/paired_playback.js";
import { offerSides, pathButton, playerOn, showScale } from "../viewer/controls.js";
import { hasWebGL, load } from "../viewer/scene.js";
import { at as hrefOf, copyText, element, get, later, radians, toast } from "../lib/text.js";

const LOOK_MS = 2000; // between two requests for the facts of a running fold
const START_MS = 600; // delay of the 3D views, which would block the first drawings
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
/** @type {Facts[]} */
const facts = JSON.parse(get("facts").textContent);
/** @type {Promise<boolean>} */
const webgl = new Promise((resolve) => {
  setTimeout(() => resolve(hasWebGL()), START_MS);
});

/**
 * Show the verdict of a fold until it is over.
 * @param {string} id
 * @param {HTMLElement} verdict
 * @param {import("../player/player.js").Player} player
 */
async function follow(id, verdict, player) {
  const { askUntil } = await import("../lib/api.js");
  await askUntil(`/folds/${id}/facts`, LOOK_MS, (/** @type {Facts} */ now) => {
    verdict.textContent = now.verdict.text;
    verdict.dataset.tone = now.verdict.tone;
    if (!now.running && !now.frames) pair.leave(player);
    return !now.running;
  }).catch(() => {}); // deleted meanwhile
  player.timeline.finish();
}

const checking = later(() => import("../panels/plan_check.js"), toast);
const sides = facts.map((fold, k) => {
  const { id, running } = fold;
  const side = get(`side-${k}`);
  const frame = /** @type {HTMLIFrameElement} */ (side.querySelector("iframe"));
  const canvas = /** @type {HTMLCanvasElement} */ (side.querySelector("canvas"));
  const now = /** @type {HTMLElement} */ (side.querySelector(".side-now"));
  const { player, stage } = playerOn(
    new Timeline(new Source(hrefOf(`/folds/${id}`)), { over: !running }),
    frame,
    canvas,
    { calm },
  );
  player.on("state", (/** @type {State} */ { error_rad: error }) => {
    now.textContent = error === null ? "" : `Joint error ${radians(error)}`;
  });
  if (running) follow(id, /** @type {HTMLElement} */ (side.querySelector(".verdict")), player);
  const check = /** @type {HTMLButtonElement} */ (side.querySelector(".check-here"));
  check.onclick = () =>
    checking(({ checkInDialog }) =>
      checkInDialog(player, fold, (at) => {
        pair.send({ do: "seek", frame: pair.frameAt(player, at) });
      }),
    );
  webgl.then((available) =>
    setTimeout(() => {
      if (available) load(frame, hrefOf("/view"));
    }, 1500 * k),
  );
  return { player, stage };
});
const pair = new Pair(sides.map(({ player }) => player));
offerSides(pair);
new Keys(pair, new Bar(pair));
facts.forEach(({ running, frames }, k) => {
  if (!running && !frames) pair.leave(sides[k].player);
});
pair.on("begun", () => {
  if (!place.go() && !calm) pair.send({ do: "play" });
});
const colours = get("colour-by");
colours.append(
  ...COLOURINGS.filter(([key]) => !(key in MEASURED)).map(([key, label]) =>
    element("option", { value: key }, label),
  ),
);
/** @param {string} key */
function colourBy(key) {
  if (![...colours.options].some(({ value }) => value === key)) return;
  for (const { player } of sides) player.colourBy(colouringFor(key, player.timeline, null));
  scale();
  place.note();
}
colours.onchange = () => colourBy(colours.value);
const scale = () => {
  const { colouring, timeline } = sides[0].player;
  if (!colouring) return;
  colours.value = colouring.key;
  showScale(colouring, timeline);
};
pair.on("outline", scale);
let missing = "none"; // modules without a value, as the legend says
sides[0].player.on("drawn", () => {
  const { colouring } = sides[0].player;
  if (!colouring || colouring.missing === missing) return;
  ({ missing } = colouring);
  scale();
});
const through = pathButton(sides.map(({ stage }) => stage));
const place = new Place(
  {
    player: pair,
    view() {
      const view = viewOf(sides[0].player, through.on);
      return view && { ...view, ...pair.moment };
    },
    colour: colourBy,
    path: (on) => through.set(on),
  },
  calm,
);
through.changed = () => place.note();
get("share").onclick = () =>
  copyText(
    location.origin + place.here(),
    () => toast("Link copied"),
    () => toast(location.href),
  );
