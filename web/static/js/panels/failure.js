// The reason why a fold is not verified: a card over the view, and the modules where it stalled.
import { get } from "../lib/text.js";
import { clearestSight } from "../viewer/viewpoint.js";

const narrow = matchMedia("(max-width: 760px)");

export class Failure {
  /**
   * @param {{ player: import("../player/player.js").Player, bar: import("../player/bar.js").Bar,
   *   drawer: import("./drawer.js").Drawer }} around
   */
  constructor({ player, bar, drawer }) {
    this.player = player;
    /** @type {Failing | null} */
    this.failure = null;
    this.bar = bar;
    bar.onStuck = () => this.go();
    get("verdict").onclick = (event) => {
      if (/** @type {HTMLElement} */ (event.target).id !== "verdict-go") return;
      event.preventDefault(); // the link alone would not turn the view to the modules
      this.go();
    };
    get("stuck").onclick = ({ target }) => {
      const { id } = /** @type {HTMLElement} */ (target);
      if (id === "stuck-go") this.go();
      if (id !== "stuck-attempts") return;
      drawer.openAt("attempts");
      if (narrow.matches) this.unfold(false);
    };
    get("attempts")?.addEventListener("click", ({ target }) => {
      const { module } = /** @type {HTMLElement} */ (target).dataset;
      if (module === undefined) return;
      this.go();
      player.send({ do: "select", module: Number(module) });
    });
    player.on("begun", () => this.mark());
  }

  /** @param {Facts} facts */
  facts({ failure, frames }) {
    this.failure = frames ? failure : null;
    this.bar.sticksAt(this.failure);
    this.unfold(!narrow.matches);
    this.mark();
  }

  /** @param {boolean} open */
  unfold(open) {
    if (!open && get("stuck-more").contains(document.activeElement)) get("stuck-fold").focus();
    get("stuck-card").open = open;
  }

  mark() {
    if (this.player.timeline.chain) this.player.mark(this.failure?.modules ?? []);
  }

  // Show the frame where the fold stalled, with the camera at the modules.
  go() {
    if (!this.failure) return;
    const { frame, modules } = this.failure;
    this.player.send({ do: "seek", ...(frame === null ? { percent: 100 } : { frame }) });
    this.player.lookAt(modules, clearestSight);
    if (narrow.matches) this.unfold(false);
  }
}
