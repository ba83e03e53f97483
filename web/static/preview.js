// The preview page: wishes in the panel, their report in figures, and the scene that shows it.
import { UNREACHABLE, askForFold } from "./asking.js";
import { changed, follow, refused } from "./paper_settings.js";
import { PreviewStage } from "./preview_stage.js";
import { hasWebGL } from "./scene.js";
import { element, refusal, sentence, whole, duration } from "./words.js";

const get = (id) => document.getElementById(id);
const facts = JSON.parse(get("facts").textContent);
const LEAST = 8;
const PATIENCE_MS = 220;
const DRAW_MS = 100;
const HINTS = {
  auto: "The way that suits the shape.",
  blocks: "Each voxel becomes 2×2×2 modules: there is a path in any case, and it folds best.",
  exact: "One module for each voxel. Finer, but there may be no path.",
  snake: "Back and forth, layer by layer. For boxes only.",
};

// Wishes live in the address, so that a link shows the same.
const query = new URLSearchParams(location.search);
const wishes = {
  module: query.get("module") === "tetrahedron" ? "tetrahedron" : "cube",
  modules: Number(query.get("modules")) || null,
  method: HINTS[query.get("method")] ? query.get("method") : "auto",
  ends: query.get("ends") === "surface" ? "surface" : "any",
  repair: query.get("repair") === "true",
  as_voxels: query.get("as_voxels") === "true",
  start: /^-?\d+,-?\d+,-?\d+$/.test(query.get("start") ?? "") ? query.get("start") : null,
  seed: Number(query.get("seed")) || 0,
};
let report = null;
let picked = null;
let running = false;
let again = false;
let timer = null;

const modulesAt = (place) => Math.round(LEAST * (facts.most_modules / LEAST) ** (place / 1000));
const placeOf = (modules) => Math.round((1000 * Math.log(modules / LEAST)) / Math.log(facts.most_modules / LEAST));

function form() {
  const form = new FormData();
  form.set("preview", facts.id);
  for (const [key, value] of Object.entries(wishes)) if (value !== null) form.set(key, String(value));
  return form;
}

function remember() {
  const kept = new URLSearchParams();
  for (const [key, value] of Object.entries(wishes)) {
    if (value && !["auto", "any", "cube"].includes(value)) kept.set(key, String(value));
  }
  history.replaceState(null, "", `${location.pathname}${kept.size ? `?${kept}` : ""}`);
}

function busy(on) {
  get("progress").hidden = !on;
  document.body.classList.toggle("busy-now", on);
  get("fold").disabled = on || !report?.has_path;
  settle();
}

// What is shown is not yet, or is, that of the figures.
function settle() {
  document.querySelector(".stage").setAttribute("aria-busy", String(running || stage.waiting));
}

function cover(text, more = "", still = true) {
  const cover = get("cover");
  cover.classList.remove("gone", "drawn");
  get("drawing").hidden = true;
  cover.classList.toggle("still", still);
  get("cover-text").textContent = text;
  get("cover-more").textContent = more;
  get("cover-button").hidden = !still;
}

function problem(text) {
  get("problem").hidden = !text;
  get("problem").textContent = text;
}

// One request at a time; what was wished for meanwhile is asked for next.
async function look() {
  clearTimeout(timer);
  if (running) { again = true; return; }
  running = true;
  busy(true);
  remember();
  const body = form();
  body.set("full", "false");
  try {
    const answer = await fetch("/api/shapes/preview", { method: "POST", body });
    const told = await answer.json().catch(() => ({}));
    if (answer.ok) {
      report = told;
      picked = null;
      problem(sentence(told.not_started));
      // What is shown is another path, so that one is folded unless something else is wished for.
      if (told.not_started) { wishes.start = null; remember(); }
      show();
    } else {
      const said = refusal(told, answer.status);
      wishes.start = null;
      if (report) {
        report = { ...report, has_path: false };
        problem(said);
        get("verdict").textContent = "No preview for these wishes";
      } else cover("This shape cannot be shown", said);
    }
  } catch {
    problem(UNREACHABLE);
    if (!report) cover("The server cannot be reached", "Check the connection, then load the page again.");
  }
  running = false;
  busy(false);
  if (again) { again = false; look(); }
}

function soon() {
  clearTimeout(timer);
  document.body.classList.add("busy-now");
  timer = setTimeout(look, PATIENCE_MS);
}

function put(id, text, tone = "") {
  get(id).textContent = text;
  get(id).dataset.tone = tone;
}


function expected() {
  const seconds = get("preset").value === "paper" ? report.expected_as_published_s : report.expected_s;
  put("expected", report.has_path ? duration(seconds) : "–");
}

function show() {
  const { kind, name, modules, iou, feasibility, knot, has_path: path } = report;
  get("name").textContent = name;
  document.title = `${name}, preview · foldback`;
  const kept = iou === null ? "" : ` · ${Math.round(100 * iou)} % of the shape`;
  const parts = report.module === "cube" ? "modules" : "tetrahedra";
  get("verdict").textContent = path ? `${whole(modules)} ${parts}${kept}` : `${whole(modules)} cells, no path yet`;

  const resizable = kind === "mesh";
  const fixed = kind === "path" || kind === "chain";
  get("what").hidden = kind === "chain";
  get("how").hidden = fixed;
  get("method-part").hidden = get("method-hint").hidden = wishes.module !== "cube";
  get("modules-part").hidden = !resizable;
  if (resizable && !wishes.modules) set(modules, false);
  const asked = report.asked ?? modules;
  const nearest = asked === modules ? "" : `${whole(modules)} is nearest to ${whole(asked)}`;
  get("got").textContent = [bound, nearest].filter(Boolean).join("; ") || "Also possible";
  const near = [report.below, modules, report.above].filter((n) => n && n !== modules && n <= facts.most_modules);
  get("nearest").replaceChildren(...near.map((count) => {
    const button = element("button", { type: "button", title: "The nearest count that can be reached" }, whole(count));
    button.onclick = () => { set(count); look(); };
    return button;
  }));

  get("iou-part").hidden = iou === null;
  put("iou", iou === null ? "" : `${Math.round(100 * iou)} %`);
  get("iou-part").style.setProperty("--share", iou ?? 0);
  expected();
  put("candidates", String(report.candidates));
  const knots = { unknot: "None", knotted: "Knotted", undecided: "Undecided" };
  put("knot", knot ? knots[knot.verdict] : "–", knot?.verdict === "knotted" ? "bad" : "");
  get("knot").title = knot?.determinant ? `determinant ${knot.determinant}` : "";
  if (knot?.verdict === "knotted" && knot.determinant) get("knot").textContent += ` (${knot.determinant})`;

  const problems = feasibility?.problems ?? [];
  get("trouble").hidden = path;
  get("trouble-title").textContent = feasibility?.feasible === false
    ? "There is no path through these cells" : "No path was found";
  get("problems").replaceChildren(...problems.map(({ detail }) => element("li", {}, sentence(detail))));
  const ways = path ? [] : repairs(feasibility);
  get("repairs").replaceChildren(...ways);
  const repaired = report.notes.find((note) => note.startsWith("Repaired"));
  get("repaired").hidden = !(wishes.repair && repaired);
  get("repaired-text").textContent = repaired ?? "";

  begin();
  const unordered = report.as_voxels && !wishes.as_voxels ? report.notes[0] : null;
  get("unordered").hidden = !unordered;
  get("unordered").textContent = unordered ?? "";
  const notes = report.notes.filter((note) => note !== repaired && note !== unordered);
  get("notes-part").hidden = !notes.length;
  get("notes").replaceChildren(...notes.map((note) => element("li", {}, sentence(note))));
  get("fold").textContent = path ? `Fold ${whole(modules)} modules` : "Fold";
  get("legend").hidden = !path;
  get("layers").hidden = false;
  for (const button of get("layers").children) {
    button.hidden = (button.dataset.layer === "solid" && !resizable) || (button.dataset.layer === "path" && !path);
  }
  show3d();
  if (!viewing) draw();
}

// A drawing stands for the 3D view until that is there, or instead of it.
function draw() {
  const drawing = get("drawing");
  drawing.onload = () => {
    if (viewing) return;
    const cover = get("cover");
    cover.classList.remove("gone", "still");
    cover.classList.add("drawn");
    drawing.hidden = false;
    get("cover-button").hidden = true;
    tell3d();
    setTimeout(start3d, DRAW_MS);
  };
  drawing.onerror = () => { drawing.hidden = true; tell3d(); start3d(); };
  drawing.src = `/previews/${facts.id}/drawing.svg?key=${report.key}`;
}

function tell3d() {
  const why = flat ? "WebGL is missing or switched off" : failed ? "The 3D view could not be loaded" : "";
  get("cover-text").textContent = why ? `${why}, so this is a drawing.` : "Starting the 3D view…";
  get("cover-more").textContent = why ? "The figures hold all the same, and the shape can be folded." : "";
}

// To ask is to start the browser's 3D graphics, which takes a second where they are software.
function start3d() {
  if (started) return;
  started = true;
  if (hasWebGL()) { get("view").src = "/view"; show3d(); return; }
  flat = true;
  if (get("drawing").hidden) cover("This browser shows no 3D graphics", "WebGL is missing or switched off. The figures hold all the same, and the shape can be folded.");
  else tell3d();
}

function show3d() {
  if (!started || flat) return;
  failed = false;
  stage.show(`/previews/${facts.id}/scene/${report.key}`);
  settle();
}

// The module that was clicked, or the one that the chain was asked to begin in.
function begin() {
  const here = report?.has_path && picked;
  const first = here && picked.module === 0;
  get("start").hidden = !here && !wishes.start;
  get("start-button").hidden = Boolean(first && !wishes.start);
  if (here && !(first && wishes.start)) {
    get("start-text").textContent = `Module ${whole(picked.module + 1)} of ${whole(report.modules)}${first ? ", the first" : ""}`;
    get("start-button").textContent = "Start here";
  } else if (wishes.start) {
    get("start-text").textContent = `Starts in (${wishes.start.replaceAll(",", ", ")})`;
    get("start-button").textContent = "Undo";
  }
}

// Cells are others with other wishes, so that a cell to start in means nothing any more.
function elsewhere() { wishes.start = null; }

function repairs(feasibility) {
  const ways = (feasibility?.repairs ?? []).filter(({ add, drop }) => add.length || drop.length).slice(0, 1).map((repair) => {
    const button = element("button", { type: "button", class: "button primary" }, `Repair: ${repair.detail.charAt(0).toLowerCase()}${repair.detail.slice(1).replace(/\.$/, "")}`);
    button.onclick = () => {
      wishes.repair = true;
      if (repair.doubled) wishes.modules = repair.modules;
      elsewhere();
      look();
    };
    return button;
  });
  const apart = feasibility?.problems.some(({ code }) => code === "disconnected"); // so are their blocks
  if (wishes.method !== "blocks" && wishes.module === "cube" && !apart) {
    const button = element("button", { type: "button", class: "button" }, "Use blocks: 2×2×2 modules for each voxel");
    button.onclick = () => { choose("method", "blocks"); elsewhere(); look(); };
    ways.push(button);
  }
  return ways;
}

// How many there may be; what is beyond is taken as the bound, which is then said.
let bound = "";
function bounded(modules) {
  const count = Math.min(facts.most_modules, Math.max(LEAST, Math.round(modules) || LEAST));
  bound = count === facts.most_modules ? `At most ${whole(count)} modules` : modules < LEAST ? `At least ${LEAST} modules` : "";
  return count;
}

function set(modules, wished = true) {
  const count = bounded(modules);
  if (wished) { wishes.modules = count; elsewhere(); }
  get("modules").value = placeOf(count);
  get("modules").setAttribute("aria-valuetext", `${count} modules`);
  get("modules-number").value = count;
}

function choose(name, value) {
  wishes[name] = value;
  document.querySelector(`[name="${name}"][value="${value}"]`).checked = true;
  get("method-hint").textContent = HINTS[wishes.method];
}

get("wishes").addEventListener("submit", (event) => { event.preventDefault(); look(); });
get("modules").addEventListener("input", () => { set(modulesAt(Number(get("modules").value))); soon(); });
get("modules-number").addEventListener("change", () => { set(Number(get("modules-number").value)); look(); });
get("seed").addEventListener("change", () => { wishes.seed = Math.max(0, Math.floor(Number(get("seed").value)) || 0); elsewhere(); look(); });
follow(get("preset"));
get("preset").addEventListener("change", () => { if (report) expected(); });
for (const input of document.querySelectorAll(".choice input")) {
  input.addEventListener("change", () => { choose(input.name, input.value); if (input.name !== "ends") elsewhere(); look(); });
}
get("unrepair").onclick = () => { wishes.repair = false; elsewhere(); look(); };
get("start-button").onclick = () => {
  wishes.start = get("start-button").textContent === "Undo" ? null : picked.cell.join(",");
  look();
};
for (const button of get("layers").children) {
  button.onclick = () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    stage.layer(button.dataset.layer, on);
  };
}

get("fold").onclick = async () => {
  const button = get("fold");
  button.disabled = true;
  button.textContent = "Sending…";
  problem("");
  const body = form();
  const preset = get("preset").value;
  body.set("preset", preset);
  if (preset === "paper") for (const [key, value] of Object.entries(changed())) body.set(key, value);
  if (report.as_voxels) body.set("as_voxels", "true");
  const said = await askForFold(body);
  if (!said) return;
  problem(said); // takes its room first, so that the field is seen beside it
  problem(refused(said));
  button.disabled = false;
  button.textContent = `Fold ${whole(report.modules)} modules`;
};

// The scene.
let viewing = false;
let started = false;
let flat = false;
let failed = false;
const stage = new PreviewStage(get("view"), {
  pick: (module, cell) => { picked = module === null ? null : { module, cell }; begin(); },
  settled: settle,
  shown: () => {
    viewing = true;
    stage.painted(() => { if (viewing) get("cover").classList.add("gone"); });
  },
  failed: () => { failed = true; viewing = false; draw(); },
});

addEventListener("pageshow", (event) => { if (event.persisted) busy(false); });
choose("module", wishes.module);
choose("method", wishes.method);
choose("ends", wishes.ends);
get("seed").value = wishes.seed;
if (wishes.modules) { const { start } = wishes; set(wishes.modules); wishes.start = start; }
look();
