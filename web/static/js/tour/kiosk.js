// A fold in an exhibition: its tour plays again and again. A visitor may take over; after some time without
// input the tour begins anew. The page around it, kiosk.js in pages, hears how it goes: see docs/links.md.
import { TourPanel } from "./panel.js";

const USUAL_S = 60;
const RANGE_S = [10, 3600];
const PAUSE_MS = 3000; // before the tour begins again
const STILL_MS = 10_000; // at the folded shape, for who wants little to move and a fold without a tour
const INPUTS = ["pointerdown", "keydown", "input", "wheel"];

// Return the seconds without input that an address asks for with `kiosk`; null without it.
/** @param {string} search */
export function idleSeconds(search) {
  const asked = new URLSearchParams(search).get("kiosk");
  if (asked === null) return null;
  const seconds = Number(/^\d{1,4}$/.test(asked) ? asked : USUAL_S);
  return seconds >= RANGE_S[0] && seconds <= RANGE_S[1] ? seconds : USUAL_S;
}

export class Kiosk {
  /** @param {Omit<import("./panel.js").Toured, "id" | "toast"> & { stage: import("../viewer/stage.js").Stage }} shown */
  constructor({ stage, ...toured }) {
    this.player = toured.player;
    this.calm = toured.calm;
    this.idleMs = 1000 * (idleSeconds(location.search) ?? USUAL_S);
    this.panel = new TourPanel({ ...toured, id: null, toast: () => {} });
    this.panel.onEnd = () => this.over();
    this.held = false; // by a visitor
    this.telling = false; // without a tour
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined; // until it begins anew
    for (const kind of INPUTS) addEventListener(kind, (event) => this.touch(event.target), { capture: true, passive: true });
    const { pointer } = stage.heard;
    stage.heard.pointer = (told) => { if (told.kind !== "pointermove") this.touch(null); pointer?.(told); };
    this.player.on("camera", (/** @type {Command} */ { do: what }) => { if (what === "orbit") this.touch(null); });
    this.player.on("state", (/** @type {State} */ { playing }) => {
      if (this.telling && !playing && this.player.playhead.frame >= this.player.timeline.last) this.over();
    });
    const drag = document.querySelector("label.folded");
    if (drag) this.panel.box.prepend(drag); // from straight to folded
  }

  // Tells the page around it; the words are no secrets.
  /** @param {"ready" | "touched" | "over"} word */
  tell(word) { if (parent !== window) parent.postMessage({ kiosk: word }, "*"); }

  async begin() {
    clearTimeout(this.timer);
    this.held = this.telling = false;
    for (const dialog of document.querySelectorAll("dialog")) dialog.close();
    this.player.send({ do: "select", module: null });
    this.player.send({ do: "set", speed: 1 });
    const toured = await this.panel.open({ playing: true }).catch(() => false);
    this.tell("ready");
    if (toured || this.held) return;
    this.player.send({ do: "seek", frame: this.calm ? this.player.timeline.last : 0 });
    if (this.calm) { this.timer = setTimeout(() => this.over(), STILL_MS); return; }
    this.player.send({ do: "play" });
    this.telling = true;
  }

  over() {
    this.telling = false;
    if (this.held) return;
    this.tell("over");
    this.timer = setTimeout(() => this.begin(), PAUSE_MS);
  }

  // A visitor does something: the tour waits, and begins anew once nothing more is done.
  /** @param {EventTarget | null} target */
  touch(target) {
    this.held = true;
    this.telling = false;
    if (!(target instanceof Node && this.panel.box.contains(target))) this.panel.pause();
    this.tell("touched");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.held = false; this.over(); }, this.idleMs);
  }
}
