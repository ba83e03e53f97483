// The place in a fold that the address names: #frame=12&module=3&from=8&to=20, frames from 1 as on the
// page, the last two those that are looped over.
/** @typedef {{ frame: number | null, module: number | null, from: number | null, to: number | null }} At */

const WAIT_MS = 250;

/**
 * @param {string} hash
 * @returns {At}
 */
export function placeIn(hash) {
  const named = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (/** @type {string} */ name) => (/^\d{1,9}$/.test(named.get(name) ?? "") ? Number(named.get(name)) : null);
  const frame = (/** @type {string} */ name) => { const told = number(name); return told === null ? null : Math.max(0, told - 1); };
  const [from, to] = [frame("from"), frame("to")];
  const crossed = from !== null && to !== null && from >= to;
  return { frame: frame("frame"), module: number("module"), from: crossed ? null : from, to: crossed ? null : to };
}

/** @param {At} at */
function linkTo({ frame, module, from, to }) {
  const parts = [];
  if (frame) parts.push(`frame=${frame + 1}`);
  if (module !== null) parts.push(`module=${module}`);
  if (from !== null) parts.push(`from=${from + 1}`);
  if (to !== null) parts.push(`to=${to + 1}`);
  return location.pathname + (parts.length ? `#${parts.join("&")}` : "");
}

// Writes the place into the address while the fold rests there, so that a reload and a link show it;
// not before the visitor has done something.
export class Place {
  /** @param {import("./player.js").Player} player */
  constructor(player) {
    this.player = player;
    /** @type {At} */
    this.at = { frame: null, module: null, from: null, to: null };
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.acted = false;
    for (const kind of ["pointerdown", "keydown", "input"]) {
      addEventListener(kind, () => { this.acted = true; }, { capture: true });
    }
    addEventListener("hashchange", () => this.follow());
    player.on("state", (/** @type {State} */ { frame, playing, live, growing }) => {
      if (playing || live || !this.acted) return;
      this.note({ frame: growing ? null : Math.round(frame), ...this.range });
    });
    player.on("module", (/** @type {ModuleTold} */ { index }) => {
      this.acted ||= index !== null;
      this.note({ module: index });
    });
  }

  // Goes where the address says; true when it names a frame.
  go() {
    const { frame, module, from, to } = placeIn(location.hash);
    if (module !== null) this.player.send({ do: "select", module });
    if (from !== null || to !== null) this.player.send({ do: "set", from, to });
    const begin = frame ?? this.range.from;
    if (begin !== null) this.player.send({ do: "seek", frame: begin });
    return frame !== null;
  }

  // The same when the address was changed while the page is open: what it does not name any more goes.
  follow() {
    const { module, from, to } = placeIn(location.hash);
    this.acted = true;
    if (module === null) this.player.send({ do: "select", module });
    const looped = this.range.from !== null || this.range.to !== null;
    if (looped && from === null && to === null) this.player.send({ do: "set", from, to });
    this.go();
  }

  // The frames that are looped over.
  get range() {
    const { loop, from, to } = this.player.is;
    return { from: loop ? from : null, to: loop ? to : null };
  }

  /** @param {Partial<At>} change */
  note(change) {
    const at = { ...this.at, ...change };
    if (linkTo(at) === this.link()) return;
    this.at = at;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => history.replaceState(null, "", this.link()), WAIT_MS);
  }

  link() { return linkTo(this.at); }

  // A link to what is seen now, whether it rests or not.
  here() {
    if (!this.player.shown) return location.pathname + location.hash;
    return linkTo({ frame: Math.round(this.player.playhead.frame), module: this.player.selected, ...this.range });
  }
}
