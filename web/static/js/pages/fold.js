// The fold page.
import { Drawer } from "../panels/drawer.js";
import { Figures } from "../player/figures.js";
import { ModulePanel } from "../panels/module_panel.js";
import { Plots } from "../panels/plots.js";
import { Source } from "../player/timeline.js";
import { ask, remove, tokenOf } from "../lib/api.js";
import { view } from "../viewer/fold_view.js";
import { load } from "../viewer/scene.js";
import { at, get, later, toast, wordsOf } from "../lib/text.js";

const formOf = (/** @type {EventTarget | null} */ field) =>
  /** @type {HTMLFormElement} */ (/** @type {HTMLElement} */ (field).closest("form"));
/** @type {Facts} */
let facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
const drawer = new Drawer();
const code = new URLSearchParams(location.search).get("class"); // code of the class to follow
const { timeline, player, place, bar } = view({
  over: !facts.running,
  tightest: () => facts.tightest,
  play: code ? false : undefined,
  guide: () => !facts.running && !facts.failure && facts.frames > 0,
  source: new Source(at(`/folds/${facts.id}`)),
  figures,
  details: { drawer, ModulePanel, Plots },
  load: (frame) => load(frame, at("/view")),
  extras: {
    tour: () => ask(`/folds/${facts.id}/tour.json`),
    values: () => ask(`/folds/${facts.id}/values.json`),
    steps: () => ask(`/folds/${facts.id}/steps.json`),
    get id() {
      return facts.editable ? facts.id : null;
    },
  },
});

// Parts that most visitors do not use.
const asking = later(() => import("../lib/fold_request.js"), toast);
const checking = later(
  () =>
    import("../panels/plan_check.js").then(
      ({ Checking, planOf }) => new Checking(player, planOf(facts.id)),
    ),
  toast,
);
const choosing = later(() => import("../panels/plan_choice.js"), toast);
const companions = later(() => import("../panels/compare_refold.js"), toast);
const downloads = later(() => import("../panels/downloads.js"), toast);
const failing = later(
  () => import("../panels/failure.js").then(({ Failure }) => new Failure({ player, bar, drawer })),
  toast,
);
const dialogs = later(() => import("../panels/dialogs.js"), toast);
const film = later(async () => {
  const { filming } = await import("../film/dialog.js");
  return filming({
    player,
    name: () => get("name").textContent,
    tour: () => ask(`/folds/${facts.id}/tour.json`),
  });
}, toast);
const fullSize = later(() => import("../panels/full_size.js"), toast);
const share = later(
  () => import("../panels/share.js").then(({ sharing }) => sharing(facts, { place, player })),
  toast,
);
const progress = later(() => import("../panels/progress.js"), toast);

const token = tokenOf(facts.id);
const rename = document.getElementById("rename"); // only with a service
if (rename) {
  get("delete").hidden = !token;
  get("delete").onclick = () => {
    get("ways-list").hidePopover();
    dialogs(async ({ confirmed }) => {
      if (
        !(await confirmed(
          `Delete “${facts.name}”?`,
          "This permanently deletes the fold, its plan and its movies. The link will stop " +
            "working for everyone.",
          "Delete",
        ))
      )
        return;
      await remove(`/api/folds/${facts.id}`, token);
      location.href = at("/my-folds");
    });
  };
  rename.hidden = !token;
  rename.onclick = () => {
    // First, so that the dialog gives the focus back to the menu's button.
    get("ways-list").hidePopover();
    dialogs(({ renamed }) =>
      renamed(get("name").textContent, async (name) => {
        /** @type {Api.Fold} */
        const { title } = await ask(`/api/folds/${facts.id}`, {
          method: "PATCH",
          token,
          body: { name },
        });
        facts = { ...facts, name: title };
        get("name").textContent = title;
        document.title = `${title} · foldback`;
      }),
    );
  };
}
get("share").onclick = () => share((open) => open());
document.addEventListener("click", ({ target }) => {
  if (target instanceof Element && target.closest("[data-film]")) film((open) => open());
});
get("compare").onclick = () => companions(({ compare }) => compare(facts));
get("refold").onclick = () => companions(({ refold }) => refold(facts));
get("smooth").onclick = () =>
  dialogs(async ({ confirmed }) => {
    const question = get("smooth").dataset.question ?? "";
    if (!(await confirmed("Smooth this fold?", question, "Smooth"))) return;
    asking(({ openFold }) => openFold({ smooth: facts.id }, toast, get("smooth")));
  });
get("again").onclick = tryAgain;
get("build").onclick = (event) => {
  const { dataset, id } = /** @type {HTMLElement} */ (event.target);
  const form = facts.build?.again?.form;
  if (id === "build-again" && form)
    asking(({ openFold }) => openFold(form, toast, get("build-again")));
  if (!dataset.tab) return;
  event.preventDefault();
  drawer.openAt(dataset.tab);
};
get("verdict").addEventListener("click", (event) => {
  if (/** @type {HTMLElement} */ (event.target).id !== "verdict-check") return;
  event.preventDefault();
  drawer.openAt("properties");
  get("check").scrollIntoView();
});
get("properties").onclick = ({ target }) => {
  if (target === get("check-plan")) checking((check) => check.begin("claim"));
};
get("rests").onclick = () => {
  drawer.openAt("properties");
  /** @type {HTMLDetailsElement} */ (get("on-table").querySelector("details")).open = true;
};
get("downloads")?.addEventListener("click", ({ target }) => {
  const { id, dataset } =
    (target instanceof Element && target.closest("button")) || get("downloads");
  if (id === "cite-copy") downloads((panel) => panel.copyCitation());
  if (id === "cite-save") downloads((panel) => panel.saveCitation());
  if (dataset.check === undefined) return;
  drawer.openAt("properties");
  checking((check) => check.begin("claim"));
});
get("downloads")?.addEventListener("input", ({ target }) =>
  downloads((panel) => panel.choose(formOf(target))),
);
get("downloads")?.addEventListener("submit", (event) => {
  event.preventDefault();
  const form = formOf(event.target);
  downloads((panel) =>
    form.id === "movie" ? panel.createMovie(facts.id, form) : panel.checkMotors(facts.id, form),
  );
});

// Show the parts of the outcome that need scripts: failure, plan choice, figures.
/** @param {Facts} now */
function show(now) {
  facts = now;
  const { choice } = now;
  get("steps").hidden = !now.steps;
  if (now.failure) failing((panel) => panel.facts(now));
  if (now.options && token && rename)
    for (const name of /** @type {const} */ ([
      "change-options",
      "change-options-too",
      "more-modules",
    ]))
      get(name).hidden = false;
  if (now.full_size) {
    const { full_size: verdict, id } = now;
    fullSize(({ showFullSize }) => showFullSize(id, verdict));
  }
  if (choice) choosing(({ showChoice }) => showChoice(choice, drawer, player));
  if (!now.running) {
    timeline.finish();
    figures.begin();
  }
  get("cover-button").onclick = tryAgain;
}

// Update the rendered parts of the page from the service. Return the new facts; null if that fails.
/** @returns {Promise<Facts | null>} */
async function renewed() {
  const answer = await fetch(location.pathname).catch(() => null);
  if (!answer?.ok) return null;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const part of document.querySelectorAll("[data-renewed]")) {
    const now = /** @type {HTMLElement} */ (page.getElementById(part.id));
    part.replaceChildren(...now.childNodes);
    for (const { name, value } of now.attributes) part.setAttribute(name, value);
    part.toggleAttribute("hidden", now.hasAttribute("hidden"));
  }
  return JSON.parse(page.getElementById("facts")?.textContent ?? "");
}

// Request another fold of the same input, with options that may work better.
function tryAgain() {
  const { again } = facts;
  if (again)
    asking(({ openFold }) => openFold(again.form, toast, get("again"), get("cover-button")));
}

show(facts);
if (code)
  import("../live_class/follower.js")
    .then(({ Follower }) => new Follower(code, player, place))
    .catch((error) => toast(wordsOf(error)));
if (facts.running) {
  progress(
    ({ Progress }) =>
      new Progress(facts, async () => {
        const now = await renewed();
        if (now) show(now);
        return now;
      }),
  );
}
