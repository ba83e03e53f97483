// A fold that is embedded in another page.
import { Figures } from "../player/figures.js";
import { Source } from "../player/timeline.js";
import { ask } from "../lib/api.js";
import { view } from "../viewer/fold_view.js";
import { load } from "../viewer/scene.js";
import { at, get, later, toast } from "../lib/text.js";

/** @type {Facts} */
const facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
const zoomKey = /Mac|iPhone|iPad/.test(navigator.platform) ? "⌘" : "Ctrl";
const { hand, player } = view({
  over: !facts.running,
  tightest: () => facts.tightest,
  source: new Source(at(`/folds/${facts.id}`)),
  figures,
  load: (frame) => load(frame, at("/embed/view")),
  extras: {
    tour: () => ask(`/folds/${facts.id}/tour.json`),
    values: () => ask(`/folds/${facts.id}/values.json`),
    steps: () => ask(`/folds/${facts.id}/steps.json`),
    id: null,
  },
  onScroll: () => toast(`To zoom, click here or hold ${zoomKey}`),
});
// In full screen there is no page around it to scroll.
const yieldScrolling = () =>
  hand.yieldScrolling(window.parent !== window && !document.fullscreenElement);
document.addEventListener("fullscreenchange", yieldScrolling);
yieldScrolling();
if (!facts.running) figures.begin();
get("steps").hidden = !facts.steps;
const checking = later(() => import("../panels/plan_check.js"), toast);
get("check-here").onclick = () => checking(({ checkInDialog }) => checkInDialog(player, facts));
