// What the colours tell: a menu, and the scale with its numbers.
import { MEASURED, colouring, colouringsOf } from "../player/colours.js";
import { element, get, store, stored } from "../lib/text.js";
import { showScale } from "../viewer/controls.js";

const KEPT = "foldback:colour-by";

export class Legend {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   */
  constructor(player, figures) {
    this.player = player;
    this.figures = figures;
    this.menu = get("colour-by");
    /** @type {string | null} */
    this.asked = null; // by the address
    this.fill();
    this.menu.onchange = () => { store(KEPT, this.menu.value); this.choose(this.menu.value); };
    player.on("begun", () => {
      const kept = this.asked ?? stored(KEPT);
      if (kept && !(MEASURED.has(kept) && !figures.plots)) this.choose(kept);
    });
    player.on("outline", () => this.show());
    player.on("colouring", () => this.show());
    figures.on("begun", () => {
      this.fill();
      const kept = this.asked ?? stored(KEPT);
      if (kept && MEASURED.has(kept) && player.timeline.chain) this.choose(kept);
    });
    figures.on("loaded", () => { if (player.shown) player.show(true); });
  }

  // The colourings that there are: of a fold on a table others than of one that floats.
  fill() {
    const { plots } = this.figures;
    const before = this.menu.value;
    const known = colouringsOf(Boolean(plots?.table));
    this.menu.replaceChildren(...known.map(([key, label]) => element("option", { value: key, disabled: MEASURED.has(key) && !plots }, label)));
    if (known.some(([key]) => key === before)) this.menu.value = before;
  }

  // Takes the colouring of an address once there is what it needs; the visitor's own stays stored.
  /** @param {string} key */
  ask(key) {
    this.asked = key;
    if (!MEASURED.has(key) || this.figures.plots) this.choose(key);
  }

  /** @param {string} key */
  choose(key) {
    if (![...this.menu.options].some(({ value }) => value === key)) return;
    this.asked = null;
    const { stage } = this.player;
    if (stage) stage.pressed = key === "pressed" ? (shown) => this.figures.row(shown.low)?.pressed ?? null : null;
    this.player.colourBy(colouring(key, this.player.timeline, this.figures));
  }

  show() {
    const { colouring: chosen, timeline } = this.player;
    if (!chosen || !timeline.outline) return;
    this.menu.value = chosen.key;
    showScale(chosen, timeline);
  }
}
