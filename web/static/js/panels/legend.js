// The colour legend: a menu of colourings, and the scale with its values.
import { MEASURED, colouring, colouringsOf } from "../player/colours.js";
import { element, get, store, stored } from "../lib/text.js";
import { showScale } from "../viewer/controls.js";

const KEPT = "foldback:colour-by";
const OWN = "own";
const OTHER = "own-file";

export class Legend {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   * @param {(how: "show" | "open") => void} own shows the visitor's own values, or opens the panel to choose them
   */
  constructor(player, figures, own) {
    this.player = player;
    this.figures = figures;
    this.own = own;
    /** @type {string | null} */
    this.ownName = null;
    this.menu = get("colour-by");
    /** @type {string | null} */
    this.asked = null; // colouring in the address
    this.fill();
    this.menu.onchange = () => {
      const { value } = this.menu;
      this.show();
      if (value === OWN) own("show");
      else if (value === OTHER) own("open");
      else { store(KEPT, value); this.choose(value); }
    };
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

  // Fill the menu with the colourings of this fold, which differ between zero gravity and a table.
  fill() {
    const { plots } = this.figures;
    const before = this.menu.value;
    const known = colouringsOf(Boolean(plots?.table));
    this.menu.replaceChildren(...known.map(([key, label]) => element("option", { value: key, disabled: MEASURED.has(key) && !plots }, label)),
      ...(this.ownName === null ? [] : [element("option", { value: OWN }, this.ownName)]), element("option", { value: OTHER }, "Your own numbers…"));
    if ([...this.menu.options].some(({ value }) => value === before)) this.menu.value = before;
  }

  // Offer the visitor's own values under their name; null for none.
  /** @param {string | null} name */
  offer(name) {
    this.ownName = name;
    this.fill();
  }

  // Apply the colouring that the address names, as soon as its
  // data are loaded. The visitor's stored choice does not change.
  /** @param {string} key */
  ask(key) {
    this.asked = key;
    if (key === OWN) this.own("show");
    if (!MEASURED.has(key) || this.figures.plots) this.choose(key);
  }

  /** @param {string} key */
  choose(key) {
    if (key === OWN || ![...this.menu.options].some(({ value }) => value === key)) return;
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
