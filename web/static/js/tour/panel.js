// The tour panel over the view: captions with previous, play and next, and a list for editing.
import { Refusal, ask, tokenOf } from "../lib/api.js";
import { button, element, get, save, toast, wordsOf } from "../lib/text.js";
import { addStyle } from "../lib/lazy_styles.js";
import { cameraText } from "../player/address.js";
import { USUAL_COLOURING } from "../player/colours.js";
import { Flight } from "./flight.js";
import { MAX_CAPTION, TourState } from "./state.js";

const STYLE = "/static/css/tour.css";
const MAX_COVERED = 0.5; // largest fraction of the picture's height that counts as covered
const MAX_ABOVE = 0.25; // largest fraction of it that counts as covered by the legend above
const MAX_LEGEND_WIDTH = 0.5; // fraction of the picture's width; a wider legend covers its top
const NOBODYS = "Only the owner of this fold can save its tour. You can download the tour instead.";

/**
 * @typedef {object} Toured
 * @property {import("../player/player.js").Player} player
 * @property {import("../player/address.js").Place} place
 * @property {boolean} calm
 * @property {Tour} tour
 * @property {string | null} id of the fold, if its tour can be edited
 * @typedef {<Made>(use: (panel: TourPanel) => Made) => Promise<Made | undefined>} Touring loads the
 *   panel on first use
 */

export class TourPanel {
  /** @param {Toured} toured */
  constructor({ player, place, calm, tour, id }) {
    this.player = player;
    this.place = place;
    this.id = id;
    this.state = new TourState(tour);
    this.flight = new Flight(player, {
      calm,
      page: place.page,
      arrived: () => this.say(),
      over: () => this.next(),
      interrupted: () => {
        this.flight.end();
        this.pause();
      },
    });
    this.playing = false;
    this.onEnd = () => {}; // called after the last caption
    this.guided = false; // true while a tour is open that has started by itself
    /** @type {{ view: AddressedView, reverse: boolean } | null} */
    this.before = null; // the view before the tour
    this.looking = false; // true once the visitor has moved the camera
    player.on("camera", (/** @type {Command} */ { do: command }) => {
      if (command === "orbit") this.looking = true;
    });
    this.box = get("tour-panel");
    /** @type {Record<string, () => void>} */
    const ways = {
      before: () => this.step(-1),
      after: () => this.step(1),
      run: () => this.toggle(),
      close: () => this.close(),
      edit: () => this.fold(Boolean(get("tour-editor").hidden)),
      add: () => this.add(),
      undo: () => {
        this.state.undo();
        this.show();
      },
      draft: () => this.draft(),
      save: () => this.keep(),
      download: () => this.download(),
    };
    for (const [name, press] of Object.entries(ways)) get(`tour-${name}`).onclick = press;
    this.styled = addStyle(STYLE);
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("pointerdown", ({ target }) => this.press(target), { capture: true });
    new ResizeObserver(() => this.cover()).observe(this.box);
  }

  // Keep the chain above the panel, whose captions differ in height, and below a wide legend.
  cover() {
    const { top, height } = this.box.getBoundingClientRect();
    const picture = get("main").getBoundingClientRect();
    const share = height ? (picture.bottom - top) / picture.height : 0;
    // In an exhibition, it is below the picture.
    const stands = getComputedStyle(this.box).position === "absolute";
    const legend = get("legend").getBoundingClientRect();
    const isWide = legend.width > MAX_LEGEND_WIDTH * picture.width;
    const above = height && isWide ? (legend.bottom - picture.top) / picture.height : 0;
    this.player.cover(
      stands ? Math.min(Math.max(share, 0), MAX_COVERED) : 0,
      stands ? Math.min(Math.max(above, 0), MAX_ABOVE) : 0,
    );
  }

  // Open the tour at a stop, counted from 1. With `view` false, keep the view of the address. A
  // tour that starts by itself is `guided`: a press beside it ends it.
  /** @param {{ stop?: number, view?: boolean, playing?: boolean, guided?: boolean }} how */
  open({ stop = 1, view = true, playing = false, guided = false } = {}) {
    if (this.box.hidden) this.remember();
    this.guided = guided;
    get("tour-edit").hidden = guided || !this.id;
    this.box.hidden = false;
    get("tour").setAttribute("aria-expanded", "true");
    this.state.go(stop - 1);
    this.playing = playing;
    this.say();
    this.cover(); // before the camera jumps
    this.flight.show(this.state.stop, { view, playing, jump: true });
    this.show();
  }

  close() {
    this.playing = this.guided = false;
    this.flight.close();
    this.restore();
    this.box.hidden = true;
    this.place.stop = null;
    if (this.place.acted) this.place.write(); // at once: a reload must not open the tour again
    get("tour").setAttribute("aria-expanded", "false");
    if (this.box.contains(document.activeElement)) get("tour").focus();
  }

  // End a tour that has started by itself when the visitor presses anything beside it.
  /** @param {EventTarget | null} target */
  press(target) {
    if (!this.guided || (target instanceof Node && this.box.contains(target))) return;
    this.looking = true; // the visitor turns the view from here
    // The button itself closes the tour.
    if (!(target instanceof Node && get("tour").contains(target))) this.close();
  }

  remember() {
    this.looking = false;
    const view = this.place.page.view();
    this.before = view && { view, reverse: this.player.is.reverse };
  }

  // Restore what the stops of the tour have changed, except the frame.
  restore() {
    if (!this.before) return;
    const {
      reverse,
      view: { colour, path, from, to, loop, follow, camera },
    } = this.before;
    this.place.page.colour(colour ?? USUAL_COLOURING);
    this.place.page.path(path);
    this.player.send({ do: "set", from, to, loop, reverse, follow });
    if (!this.looking) this.player.send({ do: "camera", camera, gently: !this.flight.calm });
  }

  toggle() {
    if (this.playing) {
      this.pause();
      return;
    }
    this.playing = true;
    const restarts = this.state.at === this.state.stops.length - 1;
    if (restarts) this.state.go(0);
    this.go({ jump: restarts });
  }

  pause() {
    this.playing = false;
    this.flight.pause();
    this.say();
  }

  /** @param {number} by */
  step(by) {
    if (!this.state.go(this.state.at + by)) return;
    this.playing = false;
    this.go();
  }

  // Go to the next stop; after the last one, stop playing.
  next() {
    if (this.state.go(this.state.at + 1)) {
      this.go();
      return;
    }
    this.playing = false;
    this.say();
    this.onEnd();
  }

  go({ jump = false } = {}) {
    this.flight.show(this.state.stop, { playing: this.playing, jump });
    this.show();
  }

  // Show the number of the current stop and, once its picture is there, its caption. Until then,
  // the panel has the height that the caption needs.
  say() {
    const { state } = this;
    const { stops, stop } = state;
    const caption = get("tour-caption");
    const text = this.flight.moving ? "" : stop.caption;
    if (caption.textContent !== text) caption.textContent = text;
    caption.dataset.coming = this.flight.moving ? stop.caption : "";
    get("tour-count").textContent = `${state.at + 1} of ${stops.length}`;
    get("tour-hint").hidden = !this.guided || state.at > 0;
    get("tour-before").disabled = state.at === 0;
    get("tour-after").disabled = state.at === stops.length - 1;
    get("tour-run").textContent = this.playing ? "Pause" : "Play";
    this.place.stop = state.at;
    this.place.note();
  }

  show() {
    this.say();
    const { state } = this;
    if (get("tour-editor").hidden) return;
    get("tour-list").replaceChildren(...state.stops.map((stop, k) => this.row(stop, k)));
    this.offer();
  }

  // Update the buttons of the editor.
  offer() {
    this.say();
    get("tour-undo").disabled = !this.state.undone.length;
    get("tour-save").disabled = !this.state.changed;
  }

  /**
   * @param {TourStop} stop
   * @param {number} k
   */
  row(stop, k) {
    const { state } = this;
    const field = element("textarea", {
      rows: 3,
      maxlength: MAX_CAPTION,
      "aria-label": `Caption of stop ${k + 1}`,
    });
    field.value = stop.caption;
    // Keep the list: the click that ended the edit may be on one of its buttons.
    field.onchange = () => {
      state.edit(k, field.value);
      this.offer();
    };
    const act = (
      /** @type {string} */ sign,
      /** @type {string} */ words,
      /** @type {() => void} */ press,
      off = false,
    ) =>
      button(
        "icon-button",
        sign,
        () => {
          press();
          this.show();
          get("tour-list").children[state.at]?.querySelector("textarea")?.focus();
        },
        { "aria-label": `${words}: stop ${k + 1}`, title: words, disabled: off },
      );
    return element(
      "li",
      { "aria-current": k === state.at ? "step" : null },
      button("button quiet", `Frame ${stop.frame}`, () => {
        state.go(k);
        this.playing = false;
        this.go();
      }),
      field,
      act("↑", "Move up", () => state.move(k, -1), k === 0),
      act("↓", "Move down", () => state.move(k, 1), k === state.stops.length - 1),
      act("×", "Delete", () => state.remove(k), state.stops.length === 1),
    );
  }

  /** @param {boolean} open */
  fold(open) {
    get("tour-editor").hidden = !open;
    get("tour-edit").setAttribute("aria-expanded", String(open));
    this.show();
  }

  // Add a stop with the current view.
  add() {
    const view = this.place.page.view();
    if (!view) return;
    const { frame, module, from, to, camera, colour, path, follow } = view;
    /** @type {TourStop} */
    const stop = { caption: "Describe what is visible here.", frame: Math.round(frame ?? 0) + 1 };
    if (module !== null) stop.modules = [module + 1];
    if (from !== null && to !== null)
      Object.assign(stop, { from: Math.round(from) + 1, to: Math.round(to) + 1 });
    if (camera) stop.camera = cameraText(camera);
    if (!follow) stop.follow = false;
    if (colour && colour !== USUAL_COLOURING) stop.colour = colour;
    if (path) stop.path = true;
    if (!this.state.add(stop)) {
      toast("A tour has at most 50 stops.");
      return;
    }
    this.show();
    const field = get("tour-list").children[this.state.at]?.querySelector("textarea");
    field?.focus();
    field?.select();
  }

  async draft() {
    try {
      this.state.replace(await ask(`/api/folds/${this.id}/tour?draft=true`));
      this.go();
    } catch (error) {
      toast(wordsOf(error));
    }
  }

  async keep() {
    const { state } = this;
    const token = this.id && tokenOf(this.id);
    if (!token) {
      toast(NOBODYS);
      return;
    }
    try {
      await ask(`/api/folds/${this.id}/tour`, { method: "PUT", token, body: state.tour });
      state.keep();
      toast("Tour saved");
    } catch (error) {
      toast(error instanceof Refusal && error.gone ? NOBODYS : wordsOf(error));
    }
    this.show();
  }

  download() {
    save(
      new Blob([JSON.stringify(this.state.tour, null, 2)], { type: "application/json" }),
      "tour.json",
    );
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (
      this.box.hidden ||
      event.defaultPrevented ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      document.querySelector("dialog[open]")
    )
      return;
    if (
      event.target instanceof Element &&
      event.target.closest("textarea, input, select, [role=slider], #panel-plots")
    )
      return;
    if (event.key === "Escape" && !document.body.classList.contains("kiosk")) {
      event.preventDefault();
      this.close();
      return;
    }
    const by = { PageUp: -1, PageDown: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    this.step(by);
  }
}
