// The place in a fold that the address names: #frame=12&module=3, frames from 1 as on the page.
/** @typedef {{ frame: number | null, module: number | null }} At */

const WAIT_MS = 250;

/** @param {string} hash */
export function placeIn(hash) {
  const named = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (/** @type {string} */ name) => (/^\d{1,9}$/.test(named.get(name) ?? "") ? Number(named.get(name)) : null);
  const frame = number("frame");
  return { frame: frame === null ? null : Math.max(0, frame - 1), module: number("module") };
}

/** @param {At} at */
function linkTo({ frame, module }) {
  const parts = [];
  if (frame) parts.push(`frame=${frame + 1}`);
  if (module !== null) parts.push(`module=${module}`);
  return location.pathname + (parts.length ? `#${parts.join("&")}` : "");
}

// Writes the place into the address while the fold rests there, so that a reload and a link show it;
// not before the visitor has done something.
export class Place {
  /** @param {import("./player.js").Player} player */
  constructor(player) {
    this.player = player;
    /** @type {At} */
    this.at = { frame: null, module: null };
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.acted = false;
    for (const kind of ["pointerdown", "keydown", "input"]) {
      addEventListener(kind, () => { this.acted = true; }, { capture: true });
    }
    player.on("state", (/** @type {State} */ { frame, playing, live, growing }) => {
      if (playing || live || !this.acted) return;
      this.note({ frame: growing ? null : Math.round(frame) });
    });
    player.on("module", (/** @type {ModuleTold} */ { index }) => {
      this.acted ||= index !== null;
      this.note({ module: index });
    });
  }

  // Goes where the address says; true when it names a frame.
  go() {
    const { frame, module } = placeIn(location.hash);
    if (module !== null) this.player.send({ do: "select", module });
    if (frame === null) return false;
    this.player.send({ do: "seek", frame });
    return true;
  }

  /** @param {Partial<At>} change */
  note(change) {
    const at = { ...this.at, ...change };
    if (at.frame === this.at.frame && at.module === this.at.module) return;
    this.at = at;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => history.replaceState(null, "", this.link()), WAIT_MS);
  }

  link() { return linkTo(this.at); }

  // A link to what is seen now, whether it rests or not.
  here() {
    if (!this.player.shown) return location.pathname + location.hash;
    return linkTo({ frame: Math.round(this.player.playhead.frame), module: this.player.selected });
  }
}
