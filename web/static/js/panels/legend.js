// What the colours tell: a menu, and the scale with its numbers.
import { COLOURINGS, MEASURED, colouring } from "../player/colours.js";
import { element, get } from "../lib/text.js";

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
    this.menu.append(...COLOURINGS.map(([key, label]) => element("option", { value: key, disabled: MEASURED.has(key) && !figures.plots }, label)));
    this.menu.onchange = () => this.choose(this.menu.value);
    player.on("begun", () => {
      const kept = recall();
      if (kept && !(MEASURED.has(kept) && !figures.plots)) this.choose(kept);
    });
    player.on("outline", () => this.show());
    player.on("colouring", () => this.show());
    figures.on("begun", () => {
      for (const option of this.menu.options) option.disabled = false;
      const kept = recall();
      if (kept && MEASURED.has(kept) && player.timeline.chain) this.choose(kept);
    });
    figures.on("loaded", () => { if (player.shown) player.show(true); });
  }

  /** @param {string} key */
  choose(key) {
    try { localStorage.setItem(KEPT, key); } catch { /* not kept, then */ }
    this.player.colourBy(colouring(key, this.player.timeline, this.figures));
  }

  show() {
    const { colouring: chosen, timeline } = this.player;
    if (!chosen || !timeline.outline) return;
    this.menu.value = chosen.key;
    showScale(chosen, timeline);
  }
}

// The scale of a colouring, in numbers.
/**
 * @param {import("../player/colours.js").Colouring} chosen
 * @param {import("../player/timeline.js").Timeline} timeline
 */
export function showScale(chosen, timeline) {
  const { low, high, ramp, none } = chosen.legend();
  get("legend").hidden = false;
  get("legend").style.setProperty("--unknown", `rgb(${timeline.bundle.header.colours.unknown.join(" ")})`);
  get("legend-low").textContent = low;
  get("legend-high").textContent = high;
  get("legend-ramp").style.background = ramp;
  get("legend-none").hidden = !none;
  const meaning = get("legend-none").lastElementChild;
  if (meaning) meaning.textContent = none;
}

function recall() {
  try { return localStorage.getItem(KEPT); } catch { return null; }
}
