// The preview page: options in the panel, their report in figures, and the scene that shows it.
import { ownKey, proof } from "../lib/keys.js";
import { changed, follow, refused } from "../panels/paper_settings.js";
import { PreviewStage } from "../viewer/preview_scene.js";
import { hasWebGL } from "../viewer/scene.js";
import { UNREACHABLE, duration, element, get, later, refusal, sentence, whole } from "../lib/text.js";

/** @type {{ id: string, most_modules: number, table_modules: number, next_scripts: string[] }} */
const facts = JSON.parse(get("facts").textContent);
const layers = /** @type {HTMLElement[]} */ ([...get("layers").children]);
const LEAST = 8;
const DEBOUNCE_MS = 220;
const DRAW_MS = 100;
/** @type {Record<string, string>} */
const HINTS = {
  auto: "Picks the best method for this shape.",
  blocks: "Splits each voxel into 2×2×2 modules. A path always exists, and it folds most reliably.",
  exact: "One module for each voxel. Finer, but there may be no path.",
  snake: "Back and forth, layer by layer. For boxes only.",
};

/** @type {Record<string, string>} */
const PREFERENCES = {
  computing: "Stops at the first plan that works.",
  time: "Tries several plans and chooses the one that folds fastest.",
  torque: "Tries several plans and chooses the one that needs the least torque for the same folding time.",
  clearance: "Tries several plans and chooses the one with the most clearance.",
};

/** @type {Record<string, string>} */
const WORLDS = {
  floating: "No gravity. Fastest, and works for any shape.",
  table: "The table supports the chain at all times, so the motors need little torque.",
};

// Options live in the address, so that a link shows the same.
const query = new URLSearchParams(location.search);
const [method, start] = [query.get("method") ?? "", query.get("start") ?? ""];
/**
 * @typedef {object} PreviewOptions
 * @property {string} module
 * @property {number | null} modules
 * @property {string} method
 * @property {string} ends
 * @property {boolean} repair
 * @property {boolean} as_voxels
 * @property {string | null} start
 * @property {string} world
 * @property {number} seed
 */

/** @type {PreviewOptions} */
const options = {
  module: query.get("module") === "tetrahedron" ? "tetrahedron" : "cube",
  modules: Number(query.get("modules")) || null,
  method: Object.hasOwn(HINTS, method) ? method : "auto",
  ends: query.get("ends") === "surface" ? "surface" : "any",
  repair: query.get("repair") === "true",
  as_voxels: query.get("as_voxels") === "true",
  start: /^-?\d+,-?\d+,-?\d+$/.test(start) ? start : null,
  world: query.get("world") === "table" ? "table" : "floating",
  seed: Number(query.get("seed")) || 0,
};
/** @type {Report | null} */
let report = null;
/** @type {{ module: number, cell: number[] | null } | null} */
let picked = null;
let running = false;
let again = false;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;

const modulesAt = (/** @type {number} */ place) => Math.round(LEAST * (facts.most_modules / LEAST) ** (place / 1000));
const placeOf = (/** @type {number} */ modules) => Math.round((1000 * Math.log(modules / LEAST)) / Math.log(facts.most_modules / LEAST));

function form() {
  const fields = new FormData();
  fields.set("preview", facts.id);
  for (const [key, value] of Object.entries(options)) if (value !== null) fields.set(key, String(value));
  return fields;
}

function remember() {
  const kept = new URLSearchParams();
  for (const [key, value] of Object.entries(options)) {
    if (value && !["auto", "any", "cube", "floating"].includes(String(value))) kept.set(key, String(value));
  }
  history.replaceState(null, "", `${location.pathname}${kept.size ? `?${kept}` : ""}`);
}

/** @param {boolean} on */
function busy(on) {
  get("progress").hidden = !on;
  document.body.classList.toggle("busy-now", on);
  get("fold").disabled = on || !report?.has_path;
  settle();
}

// What is shown is not yet, or is, that of the figures.
function settle() {
  document.querySelector(".stage")?.setAttribute("aria-busy", String(running || stage.waiting));
}

/**
 * @param {string} text
 * @param {string} more
 * @param {boolean} still
 */
function cover(text, more = "", still = true) {
  get("cover").classList.remove("gone", "drawn");
  get("drawing").hidden = true;
  get("cover").classList.toggle("still", still);
  get("cover-text").textContent = text;
  get("cover-more").textContent = more;
  get("cover-button").hidden = !still;
}

/** @param {string} text */
function problem(text) {
  get("problem").hidden = !text;
  get("problem").textContent = text;
}

const asking = later(() => import("../lib/fold_request.js"), problem);

// One request at a time; what was chosen meanwhile is asked for next.
async function look() {
  clearTimeout(timer);
  seeking.abort();
  get("seeking").textContent = "";
  if (running) { again = true; return; }
  running = true;
  busy(true);
  remember();
  const body = form();
  body.set("full", "false");
  try {
    const answer = await fetch("/api/shapes/preview", { method: "POST", body, headers: proof(ownKey()) });
    const told = await answer.json().catch(() => ({}));
    if (answer.ok) {
      picked = null;
      problem(sentence(told.not_started));
      // What is shown is another path, so that one is folded unless something else is chosen.
      if (told.not_started) { options.start = null; remember(); }
      report = told;
      show(told);
    } else {
      const said = refusal(told, answer.status);
      options.start = null;
      if (report) {
        report = { ...report, has_path: false };
        const unfit = told.code === "not-for-a-table";
        if (unfit) trouble("This path cannot be folded on a table", [said], [another(), floating()]);
        problem(unfit ? "" : said);
        get("verdict").textContent = "No preview for these options";
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
  timer = setTimeout(look, DEBOUNCE_MS);
}

/**
 * @param {string} id
 * @param {string} text
 * @param {"" | "bad"} tone
 */
function put(id, text, tone = "") {
  get(id).textContent = text;
  get(id).dataset.tone = tone;
}

/** @param {Report} told */
function expected(told) {
  const preferred = get("prefer").value === "computing" ? told.expected_s : told.expected_preferred_s;
  const seconds = get("preset").value === "paper" ? told.expected_as_published_s : preferred;
  put("expected", told.has_path ? duration(seconds) : "–");
}

/** @param {Report} told */
function show(told) {
  const { kind, name, modules, iou, feasibility, knot, has_path: path } = told;
  get("name").textContent = name;
  document.title = `${name}, preview · foldback`;
  const kept = iou === null ? "" : ` · matches your model: ${Math.round(100 * iou)} %`;
  const parts = told.module === "cube" ? "modules" : "tetrahedra";
  get("verdict").textContent = path ? `${whole(modules)} ${parts}${kept}` : `${whole(modules)} cells, no path yet`;

  const resizable = kind === "mesh";
  const fixed = kind === "path" || kind === "chain";
  get("what").hidden = kind === "chain" || onTable();
  get("how").hidden = fixed || onTable();
  get("method-part").hidden = get("method-hint").hidden = options.module !== "cube";
  get("modules-part").hidden = !resizable;
  if (resizable && !options.modules) set(modules, false);
  const asked = told.asked ?? modules;
  const nearest = asked === modules ? "" : `${whole(modules)} is the closest possible count to ${whole(asked)}`;
  // A neighbouring count may have no path for a table: offers() shows those that were checked.
  const near = onTable() ? [] : [told.below, told.above].flatMap((n) => (n && n !== modules && n <= facts.most_modules ? [n] : []));
  get("got").textContent = [bound, nearest].filter(Boolean).join("; ") || (near.length ? "Also possible" : "");
  get("nearest").replaceChildren(...near.map((count) => {
    const button = element("button", { type: "button", title: "The closest count that may work" }, whole(count));
    button.onclick = () => { set(count); look(); };
    return button;
  }));

  get("iou-part").hidden = iou === null;
  put("iou", iou === null ? "" : `${Math.round(100 * iou)} %`);
  get("iou-part").style.setProperty("--share", String(iou ?? 0));
  expected(told);
  put("candidates", String(told.candidates));
  const knots = { unknot: "None", knotted: "Knotted", undecided: "Undecided" };
  put("knot", knot ? knots[knot.verdict] : "–", knot?.verdict === "knotted" ? "bad" : "");
  get("knot").title = knot?.determinant ? `determinant ${knot.determinant}` : "";
  if (knot?.verdict === "knotted" && knot.determinant) get("knot").textContent += ` (${knot.determinant})`;

  const problems = feasibility?.problems ?? [];
  trouble(
    onTable() ? `This shape can’t be folded on a table at ${whole(modules)} modules` : feasibility?.feasible === false ? "No path runs through all of these cells" : "No path was found",
    problems.map(({ detail }) => detail),
    path ? [] : onTable() ? [floating()] : repairs(feasibility),
  );
  get("trouble").hidden = path;
  warn();
  odd(told);
  if (onTable() && !path) offers();
  const repaired = told.notes.find((note) => note.startsWith("Repaired"));
  const doubled = path && onTable() && options.method === "blocks";
  get("repaired").hidden = !(options.repair && repaired) && !doubled;
  get("repaired-text").textContent = doubled ? "Each voxel became 2×2×2 modules." : repaired ?? "";

  begin();
  const unordered = told.as_voxels && !options.as_voxels ? told.notes[0] : null;
  get("unordered").hidden = !unordered;
  get("unordered").textContent = unordered ?? "";
  const notes = told.notes.filter((note) => note !== repaired && note !== unordered);
  get("notes-part").hidden = !notes.length;
  get("notes").replaceChildren(...notes.map((note) => element("li", {}, sentence(note))));
  get("fold").textContent = path ? `Fold ${whole(modules)} modules` : "Fold";
  get("legend").hidden = !path;
  get("were-added").hidden = !told.added.length;
  get("layers").hidden = false;
  for (const button of layers) {
    button.hidden = (button.dataset.layer === "solid" && !resizable) || (button.dataset.layer === "path" && !path);
  }
  picture(told.key);
}

/** @param {string} key */
function picture(key) {
  show3d(key);
  if (!viewing) draw(key);
}

// A drawing stands for the 3D view until that is there, or instead of it.
/** @param {string} key */
function draw(key) {
  const drawing = get("drawing");
  drawing.onload = () => {
    if (viewing) return;
    get("cover").classList.remove("gone", "still");
    get("cover").classList.add("drawn");
    drawing.hidden = false;
    get("cover-button").hidden = true;
    tell3d();
    setTimeout(start3d, DRAW_MS);
  };
  drawing.onerror = () => { drawing.hidden = true; tell3d(); start3d(); };
  drawing.src = `/previews/${facts.id}/drawing.svg?key=${key}${get("to-add").hidden ? "" : "&repair=true"}`;
}

function tell3d() {
  const why = flat ? "WebGL is missing or switched off" : failed ? "The 3D view could not be loaded" : "";
  get("cover-text").textContent = why ? `${why}, so you see a drawing.` : "Starting the 3D view…";
  get("cover-more").textContent = !why ? "" : report?.has_path ? "The numbers are still correct, and you can fold the shape." : "The numbers are still correct.";
}

// To ask is to start the browser's 3D graphics, which takes a second where they are software.
function start3d() {
  if (started) return;
  started = true;
  if (hasWebGL()) { get("view").src = "/view"; if (report) show3d(report.key); return; }
  flat = true;
  if (get("drawing").hidden) cover("This browser cannot show 3D graphics", "WebGL is missing or switched off. The numbers are still correct, and you can fold the shape.");
  else tell3d();
}

/** @param {string} key */
function show3d(key) {
  if (!started || flat) return;
  failed = false;
  stage.show(`/previews/${facts.id}/scene/${key}${get("to-add").hidden ? "" : "?repair=true"}`);
  settle();
}

// The module that was clicked, or the one that the chain was asked to begin in.
function begin() {
  const here = report?.has_path ? picked : null;
  const first = here?.module === 0;
  get("start").hidden = onTable() || (!here && !options.start);
  get("start-button").hidden = Boolean(first && !options.start);
  if (report && here && !(first && options.start)) {
    get("start-text").textContent = `Module ${whole(here.module + 1)} of ${whole(report.modules)}${first ? ", the first" : ""}`;
    get("start-button").textContent = "Start here";
  } else if (options.start) {
    get("start-text").textContent = `Starts in (${options.start.replaceAll(",", ", ")})`;
    get("start-button").textContent = "Undo";
  }
}

// Cells are others with other options, so that a cell to start in means nothing any more.
function elsewhere() { options.start = null; }

/** @param {Report["feasibility"]} feasibility */
function repairs(feasibility) {
  const ways = (feasibility?.repairs ?? []).filter(({ add, drop }) => add.length || drop.length).slice(0, 1).map((repair) => {
    const button = element("button", { type: "button", class: "button primary" }, `Repair: ${repair.detail.charAt(0).toLowerCase()}${repair.detail.slice(1).replace(/\.$/, "")}`);
    button.onclick = () => {
      options.repair = true;
      if (repair.doubled) options.modules = repair.modules;
      elsewhere();
      look();
    };
    return button;
  });
  const apart = feasibility?.problems.some(({ code }) => code === "disconnected"); // so are their blocks
  if (options.method !== "blocks" && options.module === "cube" && !apart) {
    const button = element("button", { type: "button", class: "button" }, "Use blocks (2×2×2 modules per voxel)");
    button.onclick = () => { choose("method", "blocks"); elsewhere(); look(); };
    ways.push(button);
  }
  return ways;
}

// Why there is nothing to fold, and what can be done about it.
/**
 * @param {string} title
 * @param {string[]} details
 * @param {HTMLElement[]} ways
 */
function trouble(title, details, ways) {
  get("trouble").hidden = false;
  get("trouble-title").textContent = title;
  get("problems").replaceChildren(...details.map((detail) => element("li", {}, sentence(detail))));
  get("repairs").replaceChildren(...ways);
}

// What the coloured cells of a shape without a path are.
/** @type {Record<string, string>} */
const ODD = {
  parity: "cells of the colour that the shape has too many of",
  disconnected: "cells not connected to the largest part",
  "dead-ends": "cells with a single neighbour",
  overhang: "cells with nothing below them",
  parts: "a layer in several parts",
};

/** @param {Report} told */
function odd(told) {
  const marked = told.has_path ? undefined : told.feasibility?.problems.find(({ cells }) => cells.length);
  get("odd").hidden = get("odd-cells").hidden = !marked;
  get("to-add").hidden = true;
  get("odd-text").textContent = marked ? ODD[marked.code] ?? "cells that prevent a path" : "";
}

// Versions of the shape that were checked to fold on a table. The search ends with the next look.
let seeking = new AbortController();
async function offers() {
  seeking = new AbortController();
  const { signal } = seeking;
  get("seeking").textContent = "Searching for a version that folds on a table…";
  const answer = await fetch("/api/shapes/offers", { method: "POST", body: form(), signal }).catch(() => null);
  if (signal.aborted) return;
  /** @type {{ offers: TableOffer[] }} */
  const told = answer?.ok ? await answer.json().catch(() => ({ offers: [] })) : { offers: [] };
  if (signal.aborted) return;
  get("seeking").textContent = told.offers.length ? "" : answer?.ok ? "No version that folds on a table was found." : "The search for other versions failed.";
  get("repairs").prepend(...told.offers.map(offered));
  get("to-add").hidden = !told.offers.some(({ added }) => added.length);
  if (report && !get("to-add").hidden) { get("odd").hidden = false; picture(report.key); }
}

/**
 * @param {TableOffer} offer
 * @param {number} place
 */
function offered({ kind, modules, change, added }, place) {
  const words = {
    repair: `Add ${added.length} cell${added.length === 1 ? "" : "s"}: ${whole(modules)} modules`,
    modules: `Use ${whole(modules)} modules, one for each voxel`,
    blocks: `Use ${whole(modules)} modules, 2×2×2 for each voxel`,
  };
  const button = element("button", { type: "button", class: place ? "button" : "button primary" }, words[kind]);
  button.onclick = () => {
    if (change.modules) set(change.modules);
    options.repair = change.repair ?? options.repair;
    choose("method", change.method ?? options.method);
    elsewhere();
    look();
  };
  return button;
}

// The cells of a path may have another one that is.
function another() {
  const button = element("button", { type: "button", class: "button primary" }, "Find another path through these cells");
  button.onclick = () => { options.as_voxels = true; look(); };
  return button;
}

// Without gravity there may be one.
function floating() {
  const button = element("button", { type: "button", class: "button" }, "Fold it in zero gravity");
  button.onclick = () => { options.as_voxels = query.get("as_voxels") === "true"; afresh(); choose("world", "floating"); look(); };
  return button;
}

// Repairs and 2×2×2 modules are chosen for one world.
function afresh() { options.repair = false; choose("method", "auto"); }

const onTable = () => options.world === "table";

// What to know before a long chain folds on a table.
function warn() {
  const long = onTable() && report && report.modules > facts.table_modules;
  get("long").textContent = long ? `Chains of more than ${whole(facts.table_modules)} modules usually get stuck on a table.` : "";
}

// What there is for a fold that floats alone goes when it is to rest on a table.
function worlds() {
  const table = onTable();
  get("world-hint").textContent = WORLDS[options.world];
  get("table-settings").hidden = !table;
  if (table) {
    elsewhere();
    if (options.method !== "blocks") choose("method", "auto");
    choose("ends", "any");
    choose("module", "cube");
    get("preset").value = "default";
    get("preset").dispatchEvent(new Event("change"));
  }
  get("preset").disabled = table;
  const tetrahedra = /** @type {HTMLInputElement} */ (document.querySelector("[name=module][value=tetrahedron]"));
  tetrahedra.disabled = table;
  prefer();
}

// What differs of the settings of a table, as a text of settings.
function tableSettings() {
  const fields = /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (get("table-settings").querySelectorAll("input, select"));
  return [...fields].map(({ name, value, dataset }) => [name, value.trim().replaceAll(",", "."), dataset.usual])
    .filter(([, value, usual]) => value && value !== usual).map(([name, value]) => `${name}=${value}`).join(",");
}

// How many there may be; what is beyond is taken as the bound, which is then said.
let bound = "";
/** @param {number} modules */
function bounded(modules) {
  const count = Math.min(facts.most_modules, Math.max(LEAST, Math.round(modules) || LEAST));
  bound = count === facts.most_modules ? `At most ${whole(count)} modules` : modules < LEAST ? `At least ${LEAST} modules` : "";
  return count;
}

/**
 * @param {number} modules
 * @param {boolean} chosen
 */
function set(modules, chosen = true) {
  const count = bounded(modules);
  if (chosen) { options.modules = count; elsewhere(); }
  get("modules").value = String(placeOf(count));
  get("modules").setAttribute("aria-valuetext", `${count} modules`);
  get("modules-number").value = String(count);
}

/**
 * @param {"module" | "method" | "ends" | "world"} name
 * @param {string} value
 */
function choose(name, value) {
  options[name] = value;
  const input = /** @type {HTMLInputElement | null} */ (document.querySelector(`[name="${name}"][value="${value}"]`));
  if (input) input.checked = true;
  get("method-hint").textContent = HINTS[options.method];
  if (name === "world") worlds();
}

get("options").addEventListener("submit", (event) => { event.preventDefault(); look(); });
get("modules").addEventListener("input", () => { set(modulesAt(Number(get("modules").value))); soon(); });
get("modules-number").addEventListener("change", () => { set(Number(get("modules-number").value)); look(); });
get("seed").addEventListener("change", () => { options.seed = Math.max(0, Math.floor(Number(get("seed").value)) || 0); elsewhere(); look(); });
follow(get("preset"));
// Only our own way has several plans to choose from.
function prefer() {
  const choosing = get("preset").value === "default" && !onTable();
  get("prefer-part").hidden = !choosing;
  if (!choosing) get("prefer").value = "computing";
  get("prefer-hint").textContent = PREFERENCES[get("prefer").value];
  if (report) expected(report);
}
for (const list of [get("preset"), get("prefer")]) list.addEventListener("change", prefer);
prefer();
for (const input of /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll(".choice input"))) {
  input.addEventListener("change", () => { if (input.name === "world") afresh(); choose(/** @type {"module" | "method" | "ends" | "world"} */ (input.name), input.value); if (input.name !== "ends") elsewhere(); look(); });
}
get("unrepair").onclick = () => { if (onTable()) afresh(); options.repair = false; elsewhere(); look(); };
get("start-button").onclick = () => {
  options.start = get("start-button").textContent === "Undo" ? null : picked?.cell?.join(",") ?? null;
  look();
};
for (const button of layers) {
  button.onclick = () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    stage.layer(button.dataset.layer ?? "", on);
  };
}

// Loads the scripts of the fold's page for a visitor who is about to ask for a fold.
function loadAhead() {
  document.head.append(...facts.next_scripts.splice(0).map((href) => element("link", { rel: "prefetch", as: "script", href })));
}
for (const name of ["pointerenter", "focus"]) get("fold").addEventListener(name, loadAhead, { once: true });

get("fold").onclick = async () => {
  if (!report) return;
  loadAhead();
  const button = get("fold");
  button.disabled = true;
  button.textContent = "Sending…";
  problem("");
  const body = form();
  const preset = get("preset").value;
  const more = /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (get("more").querySelectorAll("input, select"));
  for (const { name, value } of more) if (value && !body.has(name)) body.set(name, value);
  body.set("prefer", get("prefer").value);
  if (onTable() && tableSettings()) body.set("settings", tableSettings());
  if (preset === "paper") for (const [key, value] of Object.entries(changed())) body.set(key, value);
  if (report.as_voxels) body.set("as_voxels", "true");
  const said = await asking(({ askForFold }) => askForFold(body));
  if (said === "") return;
  if (said) {
    problem(said); // takes its room first, so that the field is seen beside it
    problem(refused(said));
  }
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
  failed: () => { failed = true; viewing = false; if (report) draw(report.key); },
});

addEventListener("pageshow", (event) => { if (event.persisted) busy(false); });
choose("module", options.module);
choose("method", options.method);
choose("ends", options.ends);
choose("world", options.world);
get("seed").value = String(options.seed);
if (options.modules) { const { start: asked } = options; set(options.modules); options.start = asked; }
look();
