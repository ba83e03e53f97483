// Address of a view: the hash describes everything that is
// visible (docs/links.md). It counts frames and modules from 1.
import { USUAL } from "./camera_rig.js";
import { USUAL_COLOURING } from "./colours.js";

const WAIT_MS = 250; // from a change until the address is updated
const PLAYING_MS = 1000; // the same during playback
const MAX_NUMBER = 1e6;
const SPEEDS = [0.05, 20];
const DEGREES = 180 / Math.PI;

const rounded = (/** @type {number} */ value, /** @type {number} */ digits) =>
  String(Number(value.toFixed(digits)));

// Return a camera as text: azimuth and elevation in degrees (empty:
// those of Follow) and the distance as a multiple of that of Follow;
// for a free camera, also the offset of its target from the chain.
/** @param {CameraAt} camera */
export function cameraText({ azimuth, elevation, zoom, offset }) {
  const turn = azimuth === null ? null : ((((azimuth * DEGREES + 180) % 360) + 360) % 360) - 180;
  const angles = [turn, elevation === null ? null : elevation * DEGREES].map((angle) =>
    angle === null ? "" : rounded(angle, 2),
  );
  return [...angles, rounded(zoom, 4), ...(offset ?? []).map((share) => rounded(share, 4))].join(
    ",",
  );
}

/**
 * @param {string | null} text
 * @returns {CameraAt | null}
 */
export function cameraIn(text) {
  const parts = text?.split(",") ?? [];
  if (!(parts.length === 3 || parts.length === 5) || parts.some((part) => part.length > 12))
    return null;
  const numbers = parts.map((part) => (part === "" ? null : Number(part)));
  if (numbers.some((n) => n !== null && !(Math.abs(n) < MAX_NUMBER))) return null;
  const [azimuth, elevation, zoom, right, up] = numbers;
  if (!zoom || zoom < 0) return null;
  const radians = (/** @type {number | null} */ degrees) =>
    degrees === null ? null : degrees / DEGREES;
  return {
    azimuth: radians(azimuth),
    elevation: radians(elevation),
    zoom,
    offset: parts.length === 5 ? [right ?? 0, up ?? 0] : null,
  };
}

/**
 * @param {string} hash
 * @returns {AddressedView}
 */
export function viewIn(hash) {
  const named = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (/** @type {string} */ name) =>
    /^\d{1,9}$/.test(named.get(name) ?? "") ? Math.max(0, Number(named.get(name)) - 1) : null;
  const flag = (/** @type {string} */ name) =>
    ({ 0: false, 1: true })[named.get(name) ?? ""] ?? null;
  const [from, to] = [number("from"), number("to")];
  const crossed = from !== null && to !== null && from >= to;
  const speed = Number(named.get("speed"));
  const colour = named.get("colour") ?? "";
  return {
    frame: number("frame"),
    module: number("module"),
    from: crossed ? null : from,
    to: crossed ? null : to,
    loop: flag("loop") ?? false,
    camera: cameraIn(named.get("camera")),
    colour: /^[a-z_-]{1,20}$/.test(colour) ? colour : null,
    path: flag("path") ?? false,
    follow: flag("follow") ?? true,
    speed: speed >= SPEEDS[0] && speed <= SPEEDS[1] ? speed : 1,
    play: flag("play") ?? flag("autoplay"),
    stop: number("stop") ?? (flag("tour") ? 0 : null),
    named: ["frame", "camera", "colour", "path", "follow"].some((name) => named.has(name)),
  };
}

// Return the hash of a view; "" for the default view of a page.
/** @param {AddressedView} view */
export function hashOf(
  { frame, module, from, to, loop, camera, colour, path, follow, speed, play, stop },
  theme = "",
  usual = USUAL_COLOURING,
) {
  const parts = [];
  if (frame !== null) parts.push(`frame=${Math.round(frame) + 1}`);
  if (module !== null) parts.push(`module=${module + 1}`);
  if (from !== null) parts.push(`from=${Math.round(from) + 1}`);
  if (to !== null) parts.push(`to=${Math.round(to) + 1}`);
  if (loop && from === null && to === null) parts.push("loop=1");
  if (camera && !(follow && cameraText(camera) === cameraText(USUAL)))
    parts.push(`camera=${cameraText(camera)}`);
  if (colour && colour !== usual) parts.push(`colour=${colour}`);
  if (path) parts.push("path=1");
  if (!follow) parts.push("follow=0");
  if (speed !== 1) parts.push(`speed=${rounded(speed, 2)}`);
  if (play) parts.push("play=1");
  if (stop !== null) parts.push(`stop=${stop + 1}`);
  if (theme) parts.push(`theme=${theme}`);
  return parts.length ? `#${parts.join("&")}` : "";
}

// Return frame and camera as a query value, for link previews: browsers do not send the hash.
/** @param {AddressedView} view */
export const shortOf = ({ frame, camera }) =>
  `${Math.round(frame ?? 0) + 1},${cameraText(camera ?? USUAL)}`;

// Keeps the view in the address, so that a reload or a link restores it. The address does not
// change before the visitor's first action.
export class Place {
  /**
   * @param {Addressed} page
   * @param {boolean} calm true if nothing starts to play by itself
   */
  constructor(page, calm) {
    this.page = page;
    this.calm = calm;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.acted = false;
    this.playing = false;
    /** @type {number | null} */
    this.stop = null; // of the open tour
    for (const kind of ["pointerdown", "keydown", "input"]) {
      addEventListener(
        kind,
        () => {
          this.acted = true;
        },
        { capture: true },
      );
    }
    addEventListener("hashchange", () => {
      this.acted = true;
      this.go();
    });
    addEventListener("themechange", () => this.note());
    addEventListener("pagehide", () => {
      if (this.timer !== undefined) this.write();
    });
    const { player } = page;
    player.on("state", (/** @type {State} */ { playing }) => {
      this.playing = playing;
      this.note();
    });
    player.on("colouring", () => this.note());
    player.on("camera", () => {
      this.acted = true;
      this.note();
    });
    player.on("module", (/** @type {ModuleTold} */ { index }) => {
      this.acted ||= index !== null;
      this.note();
    });
  }

  // Apply the address. Return true if it names a frame, or says whether to play.
  go() {
    const view = viewIn(location.hash);
    const play = view.play ?? viewIn(location.search.replace(/^\?/, "")).play;
    const { player, seen } = this.page;
    if (view.named || this.acted)
      this.page.colour(view.colour ?? player.usualColour ?? USUAL_COLOURING);
    this.page.path(view.path);
    player.send({ do: "select", module: view.module });
    player.send({
      do: "set",
      from: view.from,
      to: view.to,
      loop: view.loop || view.from !== null || view.to !== null,
      speed: view.speed,
      follow: view.follow,
    });
    const startFrame = view.frame ?? view.from;
    if (startFrame !== null) player.send({ do: "seek", frame: startFrame });
    if (view.camera) player.send({ do: "camera", camera: view.camera });
    else if (this.acted && view.follow) player.send({ do: "camera", camera: null });
    const start = () => player.send({ do: "play" });
    if (play && !this.calm && seen) seen.then(start);
    else if (play && !this.calm) start();
    if (play === false) player.send({ do: "pause" });
    return view.frame !== null || play !== null;
  }

  note() {
    if (!this.acted) return;
    if (this.playing && this.timer !== undefined) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.write(), this.playing ? PLAYING_MS : WAIT_MS);
  }

  write() {
    clearTimeout(this.timer);
    this.timer = undefined;
    const link = this.here();
    if (link !== location.pathname + location.search + location.hash)
      history.replaceState(null, "", link);
  }

  // Return a link to the current view.
  here() {
    const view = this.page.view();
    const query = new URLSearchParams(location.search);
    query.delete("view");
    const search = query.size ? `?${query}` : "";
    return (
      location.pathname +
      search +
      (view
        ? hashOf(
            { ...view, stop: this.stop },
            document.documentElement.dataset.theme,
            this.page.player.usualColour,
          )
        : location.hash)
    );
  }

  // Return the same link with the query value that link previews need.
  shared() {
    const view = this.page.view();
    const address = this.here();
    const hash = address.indexOf("#");
    return view?.frame === null || view === null || hash < 0
      ? address
      : `${address.slice(0, hash)}?view=${shortOf(view)}${address.slice(hash)}`;
  }
}

// Return the view of a player, for the address of its page.
/**
 * @param {import("./player.js").Player} player
 * @param {boolean} path
 * @returns {AddressedView | null}
 */
export function viewOf({ snapshot, playhead, is, timeline, selected, colouring, rig }, path) {
  if (!snapshot) return null;
  return {
    stop: null,
    named: false,
    frame: timeline.growing && is.live ? null : playhead.frame,
    module: selected,
    from: is.loop ? is.from : null,
    to: is.loop ? is.to : null,
    loop: is.loop,
    camera: rig.at(snapshot),
    colour: colouring?.key ?? null,
    path,
    follow: rig.follows,
    speed: is.speed,
    play: is.playing,
  };
}
