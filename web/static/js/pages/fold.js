// The fold page.
import { askForFold } from "../lib/fold_request.js";
import { showChoice } from "../panels/choice.js";
import { Companions } from "../panels/companions.js";
import { Drawer } from "../panels/drawer.js";
import { Failure } from "../panels/failure.js";
import { Figures } from "../player/figures.js";
import { Source } from "../player/timeline.js";
import { Progress } from "../panels/progress.js";
import { Share } from "../panels/share.js";
import { Downloads } from "../panels/downloads.js";
import { toast } from "../panels/toast.js";
import { view } from "../viewer/fold_view.js";
import { get } from "../lib/text.js";

/** @type {Facts} */
const facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
const drawer = new Drawer(toast);
const { timeline, player, place, bar } = view({
  over: !facts.running,
  source: new Source(`/folds/${facts.id}`), figures, drawer, load: (frame) => { frame.src = "/view"; },
});
const downloads = new Downloads(get("panel-downloads"));
const failure = new Failure({ player, bar, drawer });
const companions = new Companions(toast);

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
  get("name").textContent = now.name;
  get("verdict").textContent = now.verdict.text;
  get("verdict").dataset.tone = now.verdict.tone;
  drawer.facts(now);
  companions.facts(now);
  downloads.facts(now);
  share.facts(now);
  failure.facts(now);
  showChoice(now.choice, drawer);
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
  const refused = await askForFold(form);
  if (!refused) return;
  toast(refused);
  for (const button of buttons) button.disabled = false;
}

const share = new Share(facts, place, toast);
show(facts);
new Progress(facts, { onDone: show, toast });
