// Common parts of the pages that show one fold: the timeline, the
// 3D view with its fallback drawing, the timeline bar, the legend
// and, on pages with a drawer, the module panel and the plots.
import { Bar } from "../player/bar.js";
import { Timeline } from "../player/timeline.js";
import { Keys } from "../player/keys.js";
import { Legend } from "../panels/legend.js";
import { Place, viewIn, viewOf } from "../player/address.js";
import { offerSides, pathButton, playerOn } from "./controls.js";
import { hasWebGL } from "./scene.js";
import { get, later, store, stored, toast } from "../lib/text.js";

const DRAW_MS = 250;
const FLAT = "foldback:flat"; // stored once the visitor has read that WebGL is missing
const TOURED = "foldback:toured"; // stored once the visitor has seen a tour
/** Share of the view that must be in sight before it starts to play. */
const MIN_SHARE_IN_SIGHT = 0.25;
const START_DELAY_MS = 1500;
/**
 * Number of processor cores up to which the 3D view waits while a fold is computed, because
 * service and browser may share them: starting the view takes 3 of 11 s on two cores.
 */
const MAX_SHARED_CORES = 4;
/** Maximum wait; the page shows its own drawing meanwhile. */
const MAX_WAIT_3D_MS = 15_000;
/**
 * Minimum time between two pictures while a fold is computed on so few cores:
 * 60 pictures a second would take more time than the computation.
 */
const COMPUTING_PICTURE_MS = 66;
export const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

/**
 * The drawer and the classes of its panels.
 * @typedef {object} Details
 * @property {import("../panels/drawer.js").Drawer} drawer
 * @property {typeof import("../panels/module_panel.js").ModulePanel} ModulePanel
 * @property {typeof import("../panels/plots.js").Plots} Plots
 */

/**
 * @typedef {object} Viewed
 * @property {TimelineSource} source
 * @property {import("../player/figures.js").Figures} figures
 * @property {(frame: HTMLIFrameElement) => void} load
 * @property {boolean} [over]
 * @property {() => number | null} tightest returns the frame with the plan's smallest clearance
 * @property {Details | null} [details]
 * @property {boolean} [play]
 * @property {() => boolean} [guide] returns true if the tour of this fold may start by itself on a
 *   visitor's first visit
 * @property {{ tour: () => Promise<Tour | null>, values: () => Promise<KeptValues | null>,
 *   steps: () => Promise<PlanStep[] | null>, id: string | null }} extras
 *   tour, module values and steps of the fold; `id` is that of a fold that accepts new ones
 * @property {() => void} [onScroll] called if the page around an embed scrolls instead of a zoom
 */

// Set up the view. `load` starts loading viser's client
// into the frame; selecting a module opens the drawer.
/** @param {Viewed} viewed */
export function view({
  source,
  figures,
  load,
  tightest,
  over = true,
  details = null,
  play = !calm,
  guide = () => false,
  extras,
  onScroll,
}) {
  // Embeds can hide the controls.
  const kiosk = /[?&]kiosk=/.test(location.search);
  if (kiosk || /[?#&]controls=0\b/.test(location.search + location.hash))
    document.body.classList.add("bare");
  document.body.classList.toggle("kiosk", kiosk);
  const timeline = new Timeline(source, { over });
  const frame = get("view");
  const shares = navigator.hardwareConcurrency <= MAX_SHARED_CORES;
  const pauseMs = () =>
    shares && !timeline.over && (player.snapshot?.frame ?? 0) > 0 ? COMPUTING_PICTURE_MS : 0;
  // The page draws the fold itself until the 3D view, which takes longer to start, takes over.
  /** @type {ReturnType<typeof playerOn>} */
  const { player, stage, sketch, standIn, hand } = playerOn(timeline, frame, get("sketch"), {
    calm,
    pauseMs,
    onScroll,
    onFirst: () => {
      get("cover").classList.add("gone");
      setTimeout(start3d, DRAW_MS);
      drawn();
    },
  });
  /** @type {() => void} */
  let drawn = () => {};
  /** @type {Promise<void>} */
  const visible = new Promise((/** @type {(nothing: void) => void} */ resolve) => {
    drawn = () => resolve();
  }).then(inSight);
  standIn.onOpen = () => {
    get("cover").classList.add("gone");
    drawn();
  };
  const plots = details && new details.Plots(get("panel-plots"), player, figures);
  const bar = new Bar(
    player,
    (name) => (name === "min_clearance" ? tightest() : null) ?? plots?.worst(name) ?? null,
  );
  const ownPanel = later(async () => {
    const [{ OwnPanel }, values] = await Promise.all([
      import("../module_values/panel.js"),
      extras.values(),
    ]);
    return new OwnPanel({ player, legend, values, id: extras.id });
  }, toast);
  const legend = new Legend(player, figures, (method) => ownPanel((panel) => panel[method]()));
  takeFiles((file) => ownPanel((panel) => panel.take(file)));
  const panel =
    details &&
    new details.ModulePanel(get("panel-module"), player, figures, () =>
      details.drawer.openAt("module"),
    );
  const through = pathButton([stage]);
  const place = new Place(
    {
      player,
      view: () => viewOf(player, through.on),
      colour: (key) => legend.ask(key),
      path: (on) => through.set(on),
      seen: visible,
    },
    calm,
  );
  through.changed = () => {
    place.note();
    start3d();
  };
  offerSides(player);
  new Keys(player, bar, { alone: true, module: panel && (() => panel.begin()) });

  let started = false;
  function start3d() {
    if (started) return;
    const computing = timeline.growing && performance.now() < MAX_WAIT_3D_MS;
    if (computing && shares && !through.on) return;
    started = true;
    // The check starts the browser's 3D graphics, which takes a second with software rendering.
    if (hasWebGL()) load(frame);
    else sayFlat();
  }
  setTimeout(start3d, START_DELAY_MS);
  setTimeout(start3d, MAX_WAIT_3D_MS);
  timeline.on("settled", start3d);

  timeline.on("damaged", (/** @type {string} */ detail) => {
    get("cover").classList.remove("gone");
    get("cover-text").textContent = detail;
  });

  const touring = later(
    async () => {
      const [{ TourPanel }, tour] = await Promise.all([import("../tour/panel.js"), extras.tour()]);
      if (!tour?.stops) throw new Error("This fold has no tour yet.");
      const tourPanel = new TourPanel({ player, place, calm, tour, id: kiosk ? null : extras.id });
      await tourPanel.styled; // its height decides where the chain is shown
      return tourPanel;
    },
    (text) => {
      if (!kiosk) toast(text);
    },
  );
  const open = offerTour(touring);
  const stepping = later(async () => {
    const [{ StepsPanel }, steps] = await Promise.all([
      import("../panels/steps.js"),
      extras.steps(),
    ]);
    if (!steps) throw new Error("This fold has no steps.");
    return new StepsPanel(player, steps, calm);
  }, toast);
  get("steps").onclick = () =>
    stepping((steps) => {
      if (steps.open) steps.close();
      else steps.begin();
    });
  let introduced = false;
  player.on("begun", () => {
    if (introduced) return;
    introduced = true;
    if (kiosk) {
      import("../tour/kiosk.js").then(({ exhibit }) => exhibit({ player, calm, touring }));
      return;
    }
    const addressed = place.go();
    if (open() || addressed) return;
    if (isFirstVisit()) visible.then(() => guideOnce({ player, place, guide, touring }));
    if (player.story.telling || !play) return;
    visible.then(() => {
      const untouched = !place.acted && player.story.part === "before";
      if (untouched) player.send({ do: "play" });
    }); // from the first frame that can be seen
  });
  window.foldback = { timeline, player }; // for the console
  if (window.name === "foldback-fold" && window.parent !== window)
    import("./embed_messages.js").then(({ answer }) => answer({ player, timeline, open }));
  return { timeline, player, stage, sketch, hand, bar, place, plots };
}

// Wait until the tab of the page is in front and, within another page, the view is scrolled to.
async function inSight() {
  while (document.hidden)
    await new Promise((resolve) => {
      document.addEventListener("visibilitychange", resolve, { once: true });
    });
  await new Promise((/** @type {(nothing: void) => void} */ resolve) => {
    const observer = new IntersectionObserver(
      (entries) => {
        if (!entries.at(-1)?.isIntersecting) return;
        observer.disconnect();
        resolve();
      },
      { threshold: MIN_SHARE_IN_SIGHT },
    );
    observer.observe(get("main"));
  });
}

// Return true if this browser has not shown a tour yet, and the page is neither part of another one
// nor opened with a view in its address.
const isFirstVisit = () =>
  window.parent === window && !location.search && !location.hash && stored(TOURED) === null;

// Start the tour by itself once the fold is over and its motion has been shown, unless the visitor
// does something before. With reduced motion, it opens at its first stop and waits there.
/**
 * @param {{ player: import("../player/player.js").Player, place: Place, guide: () => boolean,
 *   touring: import("../tour/panel.js").Touring }} page
 */
function guideOnce({ player, place, guide, touring }) {
  let done = false;
  const start = () => {
    const { timeline, story } = player;
    if (done || place.acted || timeline.growing || story.telling || !guide()) return;
    done = true;
    touring((panel) => {
      // Without storage, each visit would be the first one.
      if (!place.acted && store(TOURED, "yes")) panel.open({ playing: !calm, guided: true });
    });
  };
  player.on("state", start);
  start();
}

// Say once that the browser shows a drawing, in which the chain's path is not visible.
function sayFlat() {
  get("through").disabled = true;
  get("flat").hidden = stored(FLAT) !== null;
  get("flat-close").onclick = () => {
    get("flat").hidden = true;
    store(FLAT, "read");
  };
}

// Offer the tour of the fold. Return a function that opens it at a stop, or at the stop in the
// address, and returns whether there is one.
/** @param {import("../tour/panel.js").Touring} touring */
function offerTour(touring) {
  get("tour").onclick = () =>
    touring((panel) => {
      store(TOURED, "yes");
      if (panel.box.hidden) panel.open({ playing: !calm });
      else panel.close();
    });
  const open = (/** @type {number | null} */ stopNumber = null) => {
    get("tour").hidden = false; // frames are loaded
    const { stop, named, frame } = viewIn(
      stopNumber === null ? location.hash : `#stop=${stopNumber}`,
    );
    if (stop !== null)
      touring((panel) => panel.open({ stop: stop + 1, view: !named && frame === null }));
    return stop !== null;
  };
  addEventListener("hashchange", () => {
    if (!get("tour").hidden) open();
  });
  return open;
}

// Accept files that are dropped on the view. During a
// drag, the page receives the pointer events of the frame.
/** @param {(file: File) => void} take */
function takeFiles(take) {
  const { classList } = get("main");
  for (const name of /** @type {const} */ (["dragenter", "dragover", "drop"])) {
    addEventListener(name, (event) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      classList.toggle("dropping", name !== "drop");
      const [file] = event.dataTransfer.files;
      if (name === "drop" && file) take(file);
    });
  }
  // There are no pointer moves during a drag.
  addEventListener("pointermove", () => classList.remove("dropping"));
}
