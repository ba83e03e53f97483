// The preview page: connects its controls, and requests reports, offers and a fold.
import { Refusal, ask, formOf, ownKey, tokenOf } from "../lib/api.js";
import { UNREACHABLE, at, element, get, later, sentence } from "../lib/text.js";
import { fieldsOf, fill, mark, settingsOf } from "../panels/settings.js";
import { Preview, verdictOf } from "../panels/preview_state.js";
import {
  Picture,
  choicesOnPage,
  cover,
  foldWords,
  radios,
  showOffers,
  showOptions,
  showProblem,
  showReport,
  showStart,
  showTrouble,
} from "../panels/preview_view.js";

const DEBOUNCE_MS = 220;
const UNFIT = "not-for-a-table"; // a code of the API

/** @type {import("../panels/preview_state.js").PreviewFacts} */
const facts = JSON.parse(get("facts").textContent);
const preview = new Preview(
  facts,
  choicesOnPage(),
  new URLSearchParams(facts.id ? location.search : facts.options),
);
if (![...get("preset").options].some(({ value }) => value === preview.preset))
  preview.preset = "default";
const picture = new Picture({
  pick: (module, cell) => {
    preview.picked = module === null ? null : { module, cell };
    showStart(preview, change);
  },
  settled: settle,
});
const requesting = later(() => import("../lib/fold_request.js"), showProblem);

// Mark the view as busy while it does not match the figures yet.
function settle() {
  document.querySelector(".stage")?.setAttribute("aria-busy", String(running || picture.waiting));
}

// Mark the figures as about to change.
/** @param {boolean} on */
function working(on) {
  get("progress").hidden = !on;
  document.body.classList.toggle("busy-now", on);
}

/** @param {boolean} on */
function busy(on) {
  running = on;
  working(on);
  get("fold").disabled = on || !preview.report?.has_path;
  settle();
}

// Change options and request a report.
/** @param {import("../panels/preview_state.js").Offer["change"]} changed */
function change(changed) {
  preview.change(changed);
  showOptions(preview);
  look();
}

// One request at a time; later changes are requested next.
let running = false;
let rerun = false;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;
async function look() {
  clearTimeout(timer);
  searching.abort();
  improving.abort();
  get("seeking").textContent = "";
  if (running) {
    rerun = true;
    return;
  }
  busy(true);
  if (preview.id) history.replaceState(null, "", at(preview.path));
  try {
    show(await reported({ quick: true }));
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    refuse(error);
  }
  busy(false);
  if (rerun) {
    rerun = false;
    look();
  } else if (preview.report?.final === false) improve();
}

/**
 * @param {{ quick?: boolean }} fields
 * @param {AbortSignal} [signal]
 * @returns {Promise<Api.Preview>}
 */
function reported(fields, signal) {
  const token = tokenOf(preview.id ? "" : (preview.origin.fold ?? "")) ?? ownKey();
  return ask("/api/shapes/preview", {
    body: formOf({ ...preview.fields, ...fields, full: false }),
    token,
    ...(signal && { signal }),
  });
}

// Show the final report instead of the first one, which stays if the request fails. The next
// request for a report, and a fold, abort the search: a fold searches itself.
let improving = new AbortController();
async function improve() {
  improving = new AbortController();
  const { signal } = improving;
  working(true);
  const report = await reported({}, signal).catch(() => null);
  if (signal.aborted) return;
  working(false);
  if (report) show(report);
  else if (preview.report)
    get("verdict").textContent = verdictOf({ ...preview.report, final: true });
}

/** @param {Api.Preview} report */
function show(report) {
  if (!preview.report && location.hash === "#modules") get("modules-number").focus();
  preview.take(report);
  showProblem(sentence(report.not_started));
  history.replaceState(null, "", at(preview.path));
  showOptions(preview);
  showReport(preview, report, change);
  showStart(preview, change);
  picture.show(report);
  if (preview.onTable && !report.has_path) search();
}

/** @param {Refusal} refusal */
function refuse({ message, status, code }) {
  if (!preview.report) {
    if (status) cover("This shape cannot be shown", message);
    else cover("The server cannot be reached", "Check the connection, then load the page again.");
  }
  if (!status) {
    showProblem(UNREACHABLE);
    return;
  }
  preview.refuse();
  if (!preview.report) return;
  if (code === UNFIT)
    showTrouble(
      {
        title: "This path cannot be folded on a table",
        details: [message],
        ways: preview.waysFromPath,
      },
      change,
    );
  showProblem(code === UNFIT ? "" : message);
  get("verdict").textContent = "There is no preview for these options";
}

// Search for versions of the shape that fold on a table.
// The next request for a report aborts the search.
let searching = new AbortController();
async function search() {
  searching = new AbortController();
  const { signal } = searching;
  get("seeking").textContent = "Searching for a version of the shape that folds on a table…";
  /** @type {Api.TableOffers | null} */
  const answer = await ask("/api/shapes/offers", { body: formOf(preview.fields), signal }).catch(
    () => null,
  );
  if (signal.aborted) return;
  preview.offers = answer?.offers ?? [];
  get("seeking").textContent = !answer
    ? "The search for other versions of the shape failed."
    : preview.offers.length
      ? ""
      : "No version of the shape that folds on a table was found.";
  showOffers(preview, change);
  if (preview.report && picture.repaired) picture.show(preview.report);
}

get("options").addEventListener("submit", (event) => {
  event.preventDefault();
  look();
});
// Change options while a slider moves, and request a report when it rests.
/** @param {import("../panels/preview_state.js").Offer["change"]} changed */
function slide(changed) {
  preview.change(changed);
  showOptions(preview);
  clearTimeout(timer);
  document.body.classList.add("busy-now");
  timer = setTimeout(look, DEBOUNCE_MS);
}
get("modules").addEventListener("input", () =>
  slide({ modules: preview.modulesAt(Number(get("modules").value)) }),
);
get("threshold").addEventListener("input", () =>
  slide({ threshold: Number(get("threshold").value) }),
);
get("threshold-auto").onclick = () => change({ threshold: null });
get("inside_out").addEventListener("change", () =>
  change({ inside_out: get("inside_out").checked }),
);
get("thickness").addEventListener("change", () => {
  const thickness = Math.floor(Number(get("thickness").value)) || 1;
  change({ thickness: thickness === 1 ? null : thickness });
});
get("modules-number").addEventListener("change", () =>
  change({ modules: Number(get("modules-number").value) }),
);
get("seed").addEventListener("change", () =>
  change({ seed: Math.max(0, Math.floor(Number(get("seed").value)) || 0) }),
);
for (const list of [get("preset"), get("prefer")]) {
  list.addEventListener("change", () => {
    preview.plan(get("preset").value, get("prefer").value);
    showOptions(preview);
  });
}
for (const input of radios)
  input.addEventListener("change", () => change({ [input.name]: input.value }));
get("unrepair").onclick = () =>
  change({ repair: false, ...(preview.onTable && { method: preview.choices.method[0] }) });

// The button to fold lies over what has just been opened.
get("more-choices").ontoggle = () => get("more-choices").scrollIntoView({ block: "nearest" });

// Preload the scripts of the request and of the fold
// page when the visitor is about to request a fold.
async function loadAhead() {
  await requesting(() => {}); // a browser has six connections to a server: the request goes first
  document.head.append(
    ...facts.next_scripts
      .splice(0)
      .map((href) => element("link", { rel: "prefetch", as: "script", href })),
  );
}
for (const name of ["pointerenter", "focus"])
  get("fold").addEventListener(name, loadAhead, { once: true });

get("fold").onclick = async () => {
  const { report, prefer } = preview;
  if (!report) return;
  improving.abort();
  working(false);
  const button = get("fold");
  button.disabled = true;
  button.textContent = "Sending…";
  showProblem("");
  picture.hold();
  const { settable } = preview;
  const settings = settable && settingsOf(get(`${settable}-settings`));
  const opened = requesting(({ openFold }) =>
    openFold(
      {
        ...fieldsOf(get("more-options")),
        ...preview.fields,
        prefer,
        ...(settings && { settings }),
        ...(report.as_voxels && { as_voxels: true }),
      },
      (words, values) => {
        showProblem(words); // reserves its space first, so that the field stays visible
        mark(values);
      },
    ),
  );
  loadAhead();
  if (await opened) return;
  picture.release();
  button.disabled = false;
  button.textContent = foldWords(report);
  if (report.final === false) improve();
};

addEventListener("pageshow", (event) => {
  if (event.persisted) {
    picture.release();
    busy(false);
  }
});
showOptions(preview);
if (preview.settable) fill(get(`${preview.settable}-settings`), facts.options.settings ?? "");
look();
