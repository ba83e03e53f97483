// The colour legend: a menu of colourings, and the scale with its values.
import { colouringFor, colouringsOf, isOffered } from "../player/colours.js";
import { element, get, store, stored } from "../lib/text.js";
import { showScale } from "../viewer/controls.js";

const KEPT = "foldback:colour-by";
const OWN = "own";
const OTHER = "own-file";

export class Legend {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/figures.js").Figures} figures
   * @param {(how: "show" | "open") => void} showOwn shows the visitor's own values, or opens the
   *   panel to choose them
   */
  constructor(player, figures, showOwn) {
    this.player = player;
    this.figures = figures;
    this.showOwn = showOwn;
    /** @type {string | null} */
    this.ownName = null;
    this.menu = get("colour-by");
    /** @type {string | null} */
    this.pendingKey = null; // colouring in the address or of a tour whose data are not loaded yet
    this.missing = "none"; // modules without a value, as the legend says
    // True once a colouring was asked for or chosen, so that the stored one no longer counts.
    this.decided = false;
    this.fill();
    this.menu.onchange = () => {
      const { value } = this.menu;
      this.show();
      if (value === OWN) showOwn("show");
      else if (value === OTHER) showOwn("open");
      else {
        store(KEPT, value);
        this.decided = true;
        this.choose(value);
      }
    };
    player.on("begun", () => {
      this.fill();
      this.resume();
    });
    player.on("outline", () => this.show());
    player.on("colouring", () => this.show());
    player.on("drawn", () => {
      if (player.colouring && player.colouring.missing !== this.missing) this.show();
    });
    figures.on("begun", () => {
      this.fill();
      if (player.timeline.chain) this.resume();
    });
    figures.on("loaded", () => {
      if (player.snapshot) player.show(true);
    });
  }

  // Apply the colouring that was asked for or stored, if its data are loaded now.
  resume() {
    const key = this.pendingKey ?? (this.decided ? null : stored(KEPT));
    if (key) this.choose(key);
  }

  // Fill the menu with the colourings of this fold, which differ between zero gravity and a table.
  fill() {
    const { plots } = this.figures;
    const before = this.menu.value;
    const colourings = colouringsOf(Boolean(plots?.table), this.player.timeline.bundle?.header);
    this.menu.replaceChildren(
      ...colourings.map(([key, label]) =>
        element(
          "option",
          { value: key, disabled: !isOffered(key, this.player.timeline, this.figures) },
          label,
        ),
      ),
      ...(this.ownName === null ? [] : [element("option", { value: OWN }, this.ownName)]),
      element("option", { value: OTHER }, "Your own numbers…"),
    );
    if ([...this.menu.options].some(({ value }) => value === before)) this.menu.value = before;
  }

  // Offer the visitor's own values under their name; null for none.
  /** @param {string | null} name */
  offer(name) {
    this.ownName = name;
    this.fill();
  }

  // Apply the colouring that the address or a tour names, as soon as its
  // data are loaded. The visitor's stored choice does not change.
  /** @param {string} key */
  ask(key) {
    this.pendingKey = key;
    this.decided = true;
    if (key === OWN) this.showOwn("show");
    this.choose(key);
  }

  /** @param {string} key */
  choose(key) {
    if (
      key === OWN ||
      ![...this.menu.options].some(({ value, disabled }) => value === key && !disabled)
    )
      return;
    this.pendingKey = null;
    const { stage } = this.player;
    if (stage)
      stage.pressed =
        key === "pressed" ? (snapshot) => this.figures.row(snapshot.low)?.pressed ?? null : null;
    this.player.colourBy(colouringFor(key, this.player.timeline, this.figures));
  }

  show() {
    const { colouring, timeline } = this.player;
    if (!colouring || !timeline.outline) return;
    this.menu.value = colouring.key;
    this.missing = colouring.missing;
    showScale(colouring, timeline);
  }
}
