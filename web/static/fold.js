// The fold page.
import { Bar } from "./bar.js";
import { Drawer } from "./drawer.js";
import { Figures } from "./figures.js";
import { Film, Source } from "./film.js";
import { Legend } from "./legend.js";
import { ModulePanel } from "./module_panel.js";
import { Place } from "./place.js";
import { Plots } from "./plots.js";
import { Player } from "./player.js";
import { Progress } from "./progress.js";
import { Sketch } from "./sketch.js";
import { Stage, hasWebGL } from "./stage.js";
import { copyText, refusal } from "./words.js";

const get = (id) => document.getElementById(id);
const facts = JSON.parse(get("facts").textContent);
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

let toastTimer;
function toast(text) {
  const toast = get("toast");
  toast.textContent = text;
  toast.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => { toast.hidden = true; }, 2600);
}

function cover(text, more = "", button = null) {
  get("cover-other").hidden = !button;
  get("cover").classList.remove("gone");
  get("cover-text").textContent = text;
  get("cover-more").textContent = more;
  get("cover-button").hidden = button === null;
  if (button) { get("cover-button").textContent = button.text; get("cover-button").onclick = button.press; }
}

// The page draws the fold by itself until the 3D view, which takes longer to start, has taken over.
const DRAW_MS = 250;
const PATIENCE_MS = 1500;
const film = new Film(new Source(facts.id));
const stage = new Stage(get("view"), {
  open: () => setTimeout(uncover, DRAW_MS),
  pick: (origin, direction) => player.pick(origin, direction),
  touch: () => { if (player.is.follow) player.send({ do: "set", follow: false }); },
  key: (event) => { place.acted = true; bar.key(event); },
});
const sketch = new Sketch(get("sketch"), () => {
  get("cover").classList.add("gone");
  setTimeout(start3d, DRAW_MS);
});
const player = new Player(film, {
  stage, sketch, aspect: () => get("view").clientWidth / Math.max(1, get("view").clientHeight),
});
const figures = new Figures(facts.id);
const drawer = new Drawer(toast);
const plots = new Plots(get("panel-plots"), player, figures);
const bar = new Bar(player, (name) => plots.worst(name));
const place = new Place(player);
new Legend(player, figures);
new ModulePanel(get("panel-module"), player, figures, () => drawer.openAt("module"));
get("through").onclick = () => {
  const on = get("through").getAttribute("aria-pressed") !== "true";
  get("through").setAttribute("aria-pressed", String(on));
  stage.seeThrough(on);
};
new ResizeObserver(() => player.show(true)).observe(get("view"));

let started = false;
function start3d() {
  if (started) return;
  started = true;
  // To ask is to start the browser's 3D graphics, which takes a second where they are software.
  if (hasWebGL()) { get("view").src = get("view").dataset.src; return; }
  get("flat").hidden = false;
  if (!sketch.worker) cover("This browser shows no 3D graphics", get("flat").textContent);
}
setTimeout(start3d, sketch.worker ? PATIENCE_MS : 0);

function uncover() {
  if (!player.shown) { player.addEventListener("drawn", () => setTimeout(uncover, DRAW_MS), { once: true }); return; }
  get("cover").classList.add("gone");
  get("sketch").classList.add("gone");
  get("sketch").addEventListener("transitionend", () => { sketch.stop(); player.sketch = null; }, { once: true });
}

addEventListener("keydown", (event) => bar.key(event));

function show(facts) {
  get("name").textContent = facts.name;
  get("verdict").textContent = facts.verdict.text;
  get("verdict").dataset.tone = facts.verdict.tone;
  drawer.facts(facts);
  if (!facts.running) figures.begin();
  const { again, problem } = facts;
  get("again").hidden = !again;
  if (again) {
    get("again").firstElementChild.textContent = get("again").title = again.text;
    get("again").setAttribute("aria-label", again.text);
    get("again").onclick = () => tryAgain(again);
  }
  if (problem && !facts.frames && !bar.outline) {
    cover(problem.heading, problem.text, again && { text: again.text, press: () => tryAgain(again) });
    get("cover-other").hidden = false;
    get("again").hidden = true; // it is on the cover
  }
}

// The same input once more, in the way that may do better.
async function tryAgain({ form }) {
  const buttons = [get("again"), get("cover-button")];
  for (const button of buttons) button.disabled = true;
  const body = new FormData();
  for (const [key, value] of Object.entries(form)) body.set(key, String(value));
  try {
    const answer = await fetch("/api/folds", { method: "POST", body });
    const told = await answer.json().catch(() => ({}));
    if (answer.ok) {
      if (told.owner_token) localStorage.setItem(`foldback:owner:${told.id}`, told.owner_token);
      location.href = `/folds/${told.id}`;
      return;
    }
    toast(refusal(told, answer.status));
  } catch {
    toast("The server cannot be reached. Check the connection and try again.");
  }
  for (const button of buttons) button.disabled = false;
}
show(facts);
new Progress(facts, { onDone: show, toast });

let begun = false;
player.on("begun", () => {
  if (begun) return;
  begun = true;
  if (!place.go() && !film.growing && !calm) player.send({ do: "play" });
});

get("share").onclick = () => {
  const link = location.origin + place.link();
  copyText(link, () => toast("Link copied"), () => toast(link));
};
