// The timeline bar: phases as two tints, the error as a small area in it, and the playhead.
import { FrameField } from "./frame_field.js";
import { LoopRange } from "./loop_range.js";
import { PHASES, get, radians, seconds } from "../lib/text.js";

const REAL = "real"; // the speed of the robot
const SVG = "http://www.w3.org/2000/svg";

const PRESSED = /** @type {const} */ (["reverse", "loop", "follow", "live"]);
const USED = /** @type {const} */ (["back", "play", "forward", "reverse", "loop", "follow", "speed", "jump"]);

export class Bar {
  /**
   * @param {Playing} player
   * @param {(figure: string) => number | null} worst
   */
  constructor(player, worst = () => null) {
    this.player = player;
    this.worst = worst;
    /** @type {BarOutline | null} */
    this.outline = null;
    /** @type {State | null} */
    this.state = null;
    this.onStuck = () => {};
    this.scrubbing = false;
    this.scrub = get("scrub");
    this.frame = new FrameField(player);
    this.range = new LoopRange(player);
    const send = (/** @type {Command} */ message) => () => player.send(message);
    get("play").onclick = send({ do: "toggle" });
    get("back").onclick = send({ do: "step", by: -1 });
    get("forward").onclick = send({ do: "step", by: 1 });
    for (const name of PRESSED) {
      get(name).onclick = () => this.press(name);
    }
    get("speed").onchange = () => this.setSpeed(get("speed").value);
    for (const option of get("speed").options) if (option.value === REAL) option.hidden = !("timeline" in player);
    this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
    this.scrub.addEventListener("pointerdown", () => { this.scrubbing = true; });
    for (const name of ["pointerup", "pointercancel", "change"]) {
      this.scrub.addEventListener(name, () => { this.scrubbing = false; });
    }
    get("folded").addEventListener("input", () => this.fold(Number(get("folded").value)));
    get("jump").onchange = () => {
      const where = get("jump").value;
      get("jump").value = "";
      if (where) this.jump(where);
    };
    get("more").onclick = () => get("more").setAttribute("aria-expanded", String(document.body.classList.toggle("all-controls")));
    get("full").hidden = !document.fullscreenEnabled;
    get("full").onclick = () => this.fullScreen();
    document.addEventListener("fullscreenchange", () => get("full").setAttribute("aria-pressed", String(Boolean(document.fullscreenElement))));
    this.enable(false);
    player.on("waiting", () => this.enable(false));
    player.on("outline", (outline) => this.draw(outline));
    player.on("state", (state) => this.show(state));
  }

  /** @param {boolean} on */
  enable(on) {
    for (const name of USED) get(name).disabled = !on;
    get("head").hidden = !on;
  }

  /** @param {number} frame */
  seek(frame) {
    this.place(frame);
    this.player.send({ do: "seek", frame });
  }

  // Where a fold came to nothing; null when it did not.
  /** @param {Failing | null} stuck */
  sticksAt(stuck) {
    for (const option of get("jump").options) if (option.value === "stuck") option.hidden = !stuck;
  }

  /** @param {string} where */
  jump(where) {
    if (where === "stuck") {
      this.onStuck();
      return;
    }
    if (where === "straight" || where === "folded") {
      if (this.folding) this.fold(where === "folded" ? 100 : 0);
      return;
    }
    const frame = this.worst(where);
    if (frame !== null) this.player.send({ do: "seek", frame });
  }

  // Presses one of the buttons that stay pressed.
  /** @param {typeof PRESSED[number]} name */
  press(name) { this.player.send({ do: "set", [name]: get(name).getAttribute("aria-pressed") !== "true" }); }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch(() => {}); // a browser may have its reasons
  }

  /** @param {string} value */
  setSpeed(value) { this.player.send({ do: "set", ...(value === REAL ? { real: true } : { speed: Number(value) }) }); }

  // The next of the speeds that are on offer, faster or, with -1, slower.
  /** @param {number} by */
  hurry(by) {
    const speeds = [...get("speed").options].map(({ value }) => Number(value)).filter(Number.isFinite);
    const now = this.state?.speed ?? 1;
    const next = by > 0 ? speeds.find((speed) => speed > now) : speeds.findLast((speed) => speed < now);
    if (next) this.player.send({ do: "set", speed: next });
  }

  /** @param {BarOutline} outline */
  draw(outline) {
    this.outline = outline;
    const { frames, phases, errors } = outline;
    this.enable(true);
    this.scrub.disabled = frames < 2;
    get("folded").disabled = !this.folding;
    this.scrub.max = String(Math.max(0, frames - 1));
    const plot = get("plot");
    plot.replaceChildren();
    const names = get("phases");
    names.replaceChildren();
    for (const phase of phases) {
      const rect = document.createElementNS(SVG, "rect");
      rect.setAttribute("class", `phase-${phase.name}`);
      const from = (1000 * phase.from) / frames;
      rect.setAttribute("x", String(from));
      rect.setAttribute("width", String((1000 * phase.to) / frames - from));
      rect.setAttribute("height", "100");
      plot.append(rect);
      const name = document.createElement("span");
      name.textContent = PHASES[phase.name];
      name.style.left = `${from / 10}%`;
      name.style.maxWidth = `${(100 * (phase.to - phase.from)) / frames}%`;
      names.append(name);
    }
    const scale = outline.error_scale_rad;
    let path = "";
    errors.forEach((error, k) => {
      const left = (1000 * k) / errors.length;
      const right = (1000 * (k + 1)) / errors.length;
      const top = 100 - 62 * Math.min(1, (error ?? 0) / scale);
      if (error) path += `M${left.toFixed(1)} 100V${top.toFixed(1)}H${right.toFixed(1)}V100z`;
    });
    const area = document.createElementNS(SVG, "path");
    area.setAttribute("class", "errors");
    area.setAttribute("d", path);
    plot.append(area);
    if (this.state) this.show({ ...this.state, frames });
  }

  /** @param {State} state */
  show(state) {
    this.state = state;
    if (!this.scrubbing) this.place(state.frame);
    for (const name of PRESSED) get(name).setAttribute("aria-pressed", String(state[name]));
    get("live").hidden = !state.growing;
    this.showFolded(state);
    const running = state.playing;
    get("play-icon").setAttribute("href", running ? "#i-pause" : "#i-play");
    get("play").setAttribute("aria-label", running ? "Pause" : "Play");
    const speed = get("speed");
    if (document.activeElement !== speed) speed.value = state.real ? REAL : String(state.speed);
    get("r-phase").textContent = PHASES[state.phase] ?? "";
    this.frame.show(state);
    this.range.show(state);
    get("r-time").textContent = state.time_s === null ? "" : seconds(state.time_s);
    get("r-pace").textContent = state.pace === null ? "" : `${Number(state.pace.toPrecision(2))}× robot speed`;
    get("r-error").textContent = state.error_rad === null ? "" : `Error ${radians(state.error_rad)}`;
    this.scrub.setAttribute("aria-valuetext",
      `${PHASES[state.phase] ?? ""}, frame ${Math.round(state.frame) + 1} of ${state.frames}`);
  }

  /** @param {State} state */
  showFolded({ folded }) {
    if (folded === null) return;
    const slider = get("folded");
    if (document.activeElement !== slider || !slider.matches(":active")) slider.value = String(100 * folded);
    get("r-folded").textContent = `${Math.round(100 * folded)} %`;
  }

  get folding() { return this.outline?.phases.findLast(({ name }) => name === "playback"); }

  // Goes to the frame of the fold itself that is folded so far.
  /** @param {number} percent */
  fold(percent) { if (this.folding) this.player.send({ do: "fold", percent }); }

  /** @param {number} frame */
  place(frame) {
    const last = Math.max(1, Number(this.scrub.max));
    get("head").style.left = `${(100 * Math.min(frame, last)) / last}%`;
    if (Number(this.scrub.value) !== Math.round(frame)) this.scrub.value = String(Math.round(frame));
  }
}
