// Why a fold is not verified: a card over the view, the modules where it sticks, and all attempts.
import { button, element, get, svg } from "../lib/text.js";
import { clearestSight } from "../viewer/viewpoint.js";

const NAMED = 4; // modules that are named one by one
const PAIR = 2; // modules that the text names
const narrow = matchMedia("(max-width: 760px)");

export class Failure {
  /** @param {{ player: import("../player/player.js").Player, bar: import("../player/bar.js").Bar, drawer: import("./drawer.js").Drawer }} around */
  constructor({ player, bar, drawer }) {
    this.player = player;
    this.drawer = drawer;
    /** @type {Failing | null} */
    this.found = null;
    bar.onStuck = () => this.go();
    get("stuck-go").onclick = () => this.go();
    get("stuck-attempts").onclick = () => {
      drawer.openAt("attempts");
      if (narrow.matches) this.unfold(false);
    };
    get("stuck-fold").onclick = () => this.unfold(Boolean(get("stuck-more").hidden));
    player.on("begun", () => this.mark());
    this.bar = bar;
  }

  /** @param {Facts} facts */
  facts({ id, failure, attempts, frames, downloads }) {
    this.found = frames ? failure : null;
    get("stuck").hidden = !this.found;
    this.bar.sticksAt(this.found);
    const tab = document.getElementById("tab-attempts"); // pages without a service have none
    get("stuck-attempts").hidden = !tab || !attempts.length;
    if (tab) {
      tab.hidden = false;
      get("stuck-attempts").textContent = attempts.length === 1 ? "Show the attempt" : `Show all ${attempts.length} attempts`;
      get("attempts").replaceChildren(...this.panel(failure, attempts, downloads.length ? `/api/folds/${id}` : null));
    }
    if (!this.found) return;
    const { heading, text, modules, knot } = this.found;
    get("stuck-heading").textContent = heading;
    get("stuck-text").textContent = text;
    get("stuck-modules").textContent = modules.length > PAIR ? named(modules) : "";
    get("stuck-knot").replaceChildren(...(knot ? [drawing(knot)] : []));
    get("stuck-knot").hidden = !knot;
    get("stuck-swatch").hidden = !modules.length;
    get("stuck-go").textContent = modules.length ? "Show where" : "Show how far it got";
    this.unfold(!narrow.matches);
    this.mark();
  }

  /** @param {boolean} open */
  unfold(open) {
    if (!open && get("stuck-more").contains(document.activeElement)) get("stuck-fold").focus();
    get("stuck-more").hidden = !open;
    get("stuck-fold").setAttribute("aria-expanded", String(open));
  }

  mark() { if (this.player.timeline.chain) this.player.mark(this.found?.modules ?? []); }

  // To the frame where it sticks, with the camera at the modules.
  go() {
    if (!this.found) return;
    const { frame, modules } = this.found;
    this.player.send({ do: "seek", ...(frame === null ? { percent: 100 } : { frame }) });
    this.player.lookAt(modules, clearestSight);
    if (narrow.matches) this.unfold(false);
  }

  /**
   * @param {Failing | null} failure
   * @param {Attempt[]} attempts
   * @param {string | null} files where plan and record are
   */
  panel(failure, attempts, files) {
    const parts = [];
    if (failure) {
      parts.push(element("h2", {}, failure.heading), element("p", {}, failure.text));
      if (failure.knot) parts.push(drawing(failure.knot));
      if (failure.blocks.length) parts.push(element("ul", { class: "blocks" }, ...failure.blocks.map((line) => element("li", {}, line))));
      if (failure.modules.length) {
        const links = failure.modules.map((module) => button("inline", String(module + 1), () => { this.go(); this.player.send({ do: "select", module }); }));
        parts.push(element("p", { class: "stuck-list" }, element("i", { class: "swatch stuck", "aria-hidden": "true" }), links.length === 1 ? "Module" : "Modules", ...links));
      }
      if (files && (failure.knot || failure.blocks.length)) parts.push(...confirming(files));
    }
    const tried = attempts.map(({ strategy, how, end, tone }, k) => element("li", { "data-tone": tone },
      element("b", {}, `${k + 1}. ${strategy}`), element("small", {}, how), element("p", {}, end)));
    if (tried.length) parts.push(element("h3", {}, "Attempts"), element("ol", { class: "attempts" }, ...tried));
    return parts;
  }
}

// How to confirm the reason without us: the checker's two files, and the two files that it reads.
/** @param {string} files */
function confirming(files) {
  const [plan, record] = ["plan.npz", "record.npz"].map((name) => element("a", { href: `${files}/${name}`, download: name }, name));
  return [
    element("h3", {}, "Check it yourself"),
    element("p", {}, "A separate program can confirm this reason from ", plan, " and ", record, " alone. You do not have to trust us."),
    element("p", {}, element("code", {}, "python foldback_check_refusals.py plan.npz record.npz")),
    element("p", {}, "The checker consists of two files. Keep them in one folder:"),
    element("p", {}, ...["foldback_check_refusals.py", "foldback_check.py"].flatMap((name) =>
      [element("a", { class: "button quiet", href: `/static/${name}`, download: true }, name), " "])),
  ];
}

// The knot as it is where the fold stopped, with gaps where a strand goes under another one.
/** @param {KnotDrawing} knot */
function drawing({ side, strokes, label }) {
  return element("figure", { class: "knot-drawing" },
    svg("svg", { class: "knot", viewBox: `0 0 ${side} ${side}`, role: "img", "aria-label": label }, ...strokes.map((d) => svg("path", { d }))),
    element("figcaption", { class: "hint" }, label));
}

/** @param {number[]} modules */
function named(modules) {
  const some = modules.slice(0, NAMED).map((module) => module + 1).join(", ");
  return `Modules ${some}${modules.length > NAMED ? ", …" : ""}`;
}
