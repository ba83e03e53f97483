// The fold page.
import { Drawer } from "../panels/drawer.js";
import { Figures } from "../player/figures.js";
import { ModulePanel } from "../panels/module_panel.js";
import { Plots } from "../panels/plots.js";
import { Source } from "../player/timeline.js";
import { ask } from "../lib/api.js";
import { toast } from "../panels/toast.js";
import { view } from "../viewer/fold_view.js";
import { load } from "../viewer/scene.js";
import { at, checkable, get, later, wordsOf } from "../lib/text.js";

/** @type {Facts} */
let facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
const drawer = new Drawer();
const code = new URLSearchParams(location.search).get("class"); // of a leader who is followed
const { timeline, player, place, bar } = view({
  over: !facts.running, play: code ? false : undefined,
  source: new Source(at(`/folds/${facts.id}`)), figures, details: { drawer, ModulePanel, Plots }, load: (frame) => load(frame, at("/view")),
  kept: {
    tour: () => ask(`/folds/${facts.id}/tour.json`), values: () => ask(`/folds/${facts.id}/values.json`), get id() { return facts.movies ? facts.id : null; }, toast,
  },
});

// Parts that most visitors do not use.
const asking = later(() => import("../lib/fold_request.js"), toast);
const checking = later(() => import("../panels/plan_check.js").then(({ Checking, planOf }) => new Checking(drawer.check, player, planOf(facts.id))), toast);
const choosing = later(() => import("../panels/plan_choice.js"), toast);
const companions = later(() => import("../panels/compare_refold.js"), toast);
const downloads = later(() => import("../panels/downloads.js"), toast);
const failing = later(() => import("../panels/failure.js").then(({ Failure }) => new Failure({ player, bar, drawer })), toast);
const renaming = later(() => import("../panels/renaming.js").then(({ offerRenaming }) => offerRenaming(facts.id,
  (name) => { show({ ...facts, name }); document.title = `${name} · foldback`; })), toast);
const share = later(() => import("../panels/share.js").then(({ sharing }) => sharing(facts, { place, player })), toast);
const progress = later(() => Promise.all([import("../panels/progress.js"), import("../panels/outcome.js")]), toast);
let listing = false; // what can be downloaded, which is looked at

document.getElementById("ways-list")?.addEventListener("beforetoggle", () => renaming(() => {}));
get("share").onclick = () => share((open) => open(facts));
const beside = (/** @type {"compare" | "refold" | "smooth"} */ way) => companions((it) => it[way](facts));
for (const way of /** @type {const} */ (["compare", "refold", "smooth"])) get(way).onclick = () => beside(way);
drawer.onCheck = () => checking((it) => it.begin("claim"));
drawer.onChosen = (tab) => {
  listing ||= tab === "downloads";
  if (tab === "downloads") downloads(({ listDownloads }) => listDownloads(facts));
};

/**
 * @param {string} text
 * @param {string} more
 * @param {{ text: string, press: () => void } | null} button
 */
function cover(text, more = "", button = null) {
  get("cover-other").hidden = !button;
  get("cover").classList.remove("gone");
  get("cover-text").textContent = text;
  get("cover-more").textContent = more;
  get("cover-button").hidden = button === null;
  if (button) { get("cover-button").textContent = button.text; get("cover-button").onclick = button.press; }
}

/** @param {Facts} now */
function show(now) {
  facts = now;
  get("name").textContent = now.name;
  get("verdict").textContent = now.verdict.text;
  get("verdict").dataset.tone = now.verdict.tone;
  drawer.facts(now);
  drawer.check.hidden = !checkable(now);
  get("compare").hidden = !now.comparable;
  get("refold").hidden = !now.refoldable;
  get("smooth").hidden = !now.smoothable;
  if (listing) downloads(({ listDownloads }) => listDownloads(now));
  if (now.failure || now.attempts.length > 1) failing((it) => it.facts(now));
  const { choice } = now;
  if (choice) choosing(({ showChoice }) => showChoice({ id: now.id, choice }, drawer, player));
  get("rests").hidden = !now.table;
  if (now.table) {
    get("rests").dataset.tone = now.table.good ? "good" : "bad";
    get("rests-text").textContent = now.table.text;
    get("rests").onclick = () => {
      drawer.openAt("properties");
      const assumed = get("on-table").querySelector("details");
      if (assumed) assumed.open = true;
    };
  }
  if (!now.running) { timeline.finish(); figures.begin(); }
  const { again, problem } = now;
  get("again").hidden = !again;
  if (again) {
    const [shown] = get("again").children;
    shown.textContent = get("again").title = again.text;
    get("again").setAttribute("aria-label", again.text);
    get("again").onclick = () => tryAgain(again);
  }
  if (problem && !now.frames && !bar.outline) {
    cover(problem.heading, problem.text, again && { text: again.text, press: () => tryAgain(again) });
    get("cover-other").hidden = false;
    get("again").hidden = true; // it is on the cover
  }
}

// The same input once more, in the way that may do better.
/** @param {Again} again */
async function tryAgain({ form }) {
  const buttons = [get("again"), get("cover-button")];
  for (const button of buttons) button.disabled = true;
  const refused = await asking(({ openFold }) => openFold(form));
  if (refused === "") return;
  if (refused) toast(refused);
  for (const button of buttons) button.disabled = false;
}

show(facts);
if (code) import("../tour/follower.js").then(({ Follower }) => new Follower(code, player, place)).catch((error) => toast(wordsOf(error)));
if (facts.running) {
  progress(([{ Progress }, { awaitOutcome, headingOf, titleOf }]) => {
    const end = awaitOutcome(toast);
    return new Progress(facts, {
      onProgress: (now, stage, verdict) => { document.title = verdict ? headingOf({ name: facts.name, verdict }) : titleOf(now, facts.name, stage); },
      onDone: (now) => { show(now); end(now); },
    });
  });
}
