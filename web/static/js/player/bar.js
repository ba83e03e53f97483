// The timeline bar: phases as two tints, an area plot of the
// error, the playhead, the frame number and the loop range.
import { element, get, number as numberText, radians, svg, integerText } from "../lib/text.js";
import { PHASES } from "./timeline.js";

const REAL = "real"; // the speed of the robot

const PRESSED = /** @type {const} */ (["reverse", "loop", "follow", "live"]);
const USED = /** @type {const} */ ([
  "back",
  "play",
  "forward",
  "reverse",
  "loop",
  "follow",
  "speed",
  "jump",
]);
const WIDE = 1000; // width of the plot behind the track; its height is 100
const HIGHEST = 62;
const FAR = 10; // frames by which Shift and the page keys move an end of the loop
/** @type {Record<string, number>} */
const STEPS = {
  ArrowLeft: -1,
  ArrowDown: -1,
  ArrowRight: 1,
  ArrowUp: 1,
  PageDown: -FAR,
  PageUp: FAR,
  Home: -Infinity,
  End: Infinity,
};

// Return one column of the error plot, as a part of an SVG path.
/**
 * @param {number | null} error
 * @param {number} scale error of the highest column
 * @param {number} left
 * @param {number} right
 */
function errorColumn(error, scale, left, right) {
  if (!error) return "";
  const top = 100 - HIGHEST * Math.min(1, error / scale);
  return `M${left.toFixed(1)} 100V${top.toFixed(1)}H${right.toFixed(1)}V100z`;
}

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
    this.scrub = get("scrub");
    this.speedHint = get("speed").title;
    this.frame = new FrameField(player);
    this.range = new LoopRange(player);
    const send = (/** @type {Command} */ message) => () => player.send(message);
    get("play").onclick = send({ do: "toggle" });
    get("back").onclick = send({ do: "step", by: -1 });
    get("forward").onclick = send({ do: "step", by: 1 });
    for (const name of PRESSED) get(name).onclick = () => this.press(name);
    get("speed").onchange = () => {
      const { value } = get("speed");
      player.send({ do: "set", ...(value === REAL ? { real: true } : { speed: Number(value) }) });
    };
    for (const option of get("speed").options)
      if (option.value === REAL) option.hidden = !("timeline" in player);
    this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
    get("folded").addEventListener("input", () => this.fold(Number(get("folded").value)));
    get("jump").onchange = () => {
      const placeName = get("jump").value;
      get("jump").value = "";
      if (placeName) this.jump(placeName);
    };
    get("more").onclick = () =>
      get("more").setAttribute(
        "aria-expanded",
        String(document.body.classList.toggle("all-controls")),
      );
    get("full").hidden = !document.fullscreenEnabled;
    get("full").onclick = () => this.fullScreen();
    document.addEventListener("fullscreenchange", () =>
      get("full").setAttribute("aria-pressed", String(Boolean(document.fullscreenElement))),
    );
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

  // Set the place where a fold failed; null if it did not fail.
  /** @param {Failing | null} stuck */
  sticksAt(stuck) {
    for (const option of get("jump").options) if (option.value === "stuck") option.hidden = !stuck;
  }

  /** @param {string} placeName */
  jump(placeName) {
    const frame = this.worst(placeName);
    if (placeName === "stuck") this.onStuck();
    else if (placeName === "straight" || placeName === "folded")
      this.fold(placeName === "folded" ? 100 : 0);
    else if (frame !== null) this.player.send({ do: "seek", frame });
  }

  // Press a toggle button.
  /** @param {typeof PRESSED[number]} name */
  press(name) {
    this.player.send({ do: "set", [name]: get(name).getAttribute("aria-pressed") !== "true" });
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch(() => {}); // the browser may refuse
  }

  // Choose the next faster speed of the menu; with -1, the next slower one.
  /** @param {number} by */
  hurry(by) {
    const speeds = [...get("speed").options]
      .map(({ value }) => Number(value))
      .filter(Number.isFinite);
    const now = this.state?.speed ?? 1;
    const next =
      by > 0 ? speeds.find((speed) => speed > now) : speeds.findLast((speed) => speed < now);
    if (next) this.player.send({ do: "set", speed: next });
  }

  /** @param {BarOutline} outline */
  draw(outline) {
    this.outline = outline;
    const { frames, phases, errors, error_scale_rad: scale } = outline;
    this.enable(true);
    this.scrub.disabled = frames < 2;
    get("folded").disabled = !this.folding;
    this.scrub.max = String(Math.max(0, frames - 1));
    const spans = phases.map(({ name, from, to }) => ({
      name,
      x: (WIDE * from) / frames,
      width: (WIDE * (to - from)) / frames,
    }));
    get("plot").replaceChildren(
      ...spans.map(({ name, x, width }) =>
        svg("rect", { class: `phase-${name}`, x, width, height: 100 }),
      ),
      svg("path", {
        class: "errors",
        d: errors
          .map((error, k) =>
            errorColumn(error, scale, (WIDE * k) / errors.length, (WIDE * (k + 1)) / errors.length),
          )
          .join(""),
      }),
    );
    get("phases").replaceChildren(
      ...spans.map(({ name, x, width }) => {
        const label = element("span", { class: name }, PHASES[name]);
        Object.assign(label.style, {
          left: `${(100 * x) / WIDE}%`,
          maxWidth: `${(100 * width) / WIDE}%`,
        });
        return label;
      }),
    );
    if (this.state) this.show({ ...this.state, frames });
  }

  /** @param {State} state */
  show(state) {
    this.state = state;
    this.place(state.frame);
    for (const name of PRESSED) get(name).setAttribute("aria-pressed", String(state[name]));
    get("live").hidden = !state.growing;
    const slider = get("folded");
    if (state.folded !== null) {
      if (document.activeElement !== slider || !slider.matches(":active"))
        slider.value = String(100 * state.folded);
      slider.style.setProperty("--share", `${slider.value}%`);
      get("r-folded").textContent = `${Math.round(100 * state.folded)} %`;
    }
    get("play-icon").setAttribute("href", state.playing ? "#i-pause" : "#i-play");
    get("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    const speed = get("speed");
    if (document.activeElement !== speed) speed.value = state.real ? REAL : String(state.speed);
    get("r-phase").textContent = PHASES[state.phase] ?? "";
    this.frame.show(state);
    this.range.show(state);
    get("r-time").textContent =
      state.time_s === null ? "" : `simulated ${numberText(state.time_s, 3)} s`;
    this.showPace(state.pace);
    get("r-error").textContent =
      state.error_rad === null ? "" : `Joint error ${radians(state.error_rad)}`;
    this.scrub.setAttribute(
      "aria-valuetext",
      `${PHASES[state.phase] ?? ""}, frame ${Math.round(state.frame) + 1} of ${state.frames}`,
    );
  }

  // Add the ratio of playing to the robot's speed to the hint of the speeds.
  /** @param {number | null} pace */
  showPace(pace) {
    const ratio = pace === null ? null : Number(pace.toPrecision(2));
    const now = ratio === null ? "" : ` Now ${ratio} times the robot’s speed.`;
    if (get("speed").title !== this.speedHint + now) get("speed").title = this.speedHint + now;
  }

  get folding() {
    return this.outline?.phases.findLast(({ name }) => name === "playback");
  }

  // Go to the playback frame that is folded by this percentage.
  /** @param {number} percent */
  fold(percent) {
    if (this.folding) this.player.send({ do: "fold", percent });
  }

  /** @param {number} frame */
  place(frame) {
    const last = Math.max(1, Number(this.scrub.max));
    get("head").style.left = `${(100 * Math.min(frame, last)) / last}%`;
    if (Number(this.scrub.value) !== Math.round(frame))
      this.scrub.value = String(Math.round(frame));
  }
}

// Return the index of the frame or module that a text names,
// counted from 1 as on the page; null if there is none.
/**
 * @param {string} text
 * @param {number} frames
 */
export function frameIn(text, frames) {
  const digits = text.replace(/\s/g, "");
  const number = /^\d{1,9}$/.test(digits) ? Number(digits) : 0;
  return number >= 1 && number <= frames ? number - 1 : null;
}

// Return the position of a pointer along the width
// of an element: 0 at its left side, 1 at its right.
/**
 * @param {number} x
 * @param {Element} within
 */
export function shareAt(x, within) {
  const { left, width } = within.getBoundingClientRect();
  return (x - left) / width;
}

// Report why the value of a field is invalid; an empty text marks it as valid.
/**
 * @param {HTMLInputElement} field
 * @param {string} reason
 */
export function refuse(field, reason) {
  field.setCustomValidity(reason);
  field.setAttribute("aria-invalid", String(reason !== ""));
  if (reason) field.reportValidity();
}

// The frame number. A click turns it into a field: Enter goes to the frame, Escape cancels.
class FrameField {
  /** @param {Playing} player */
  constructor(player) {
    this.player = player;
    this.button = get("r-frame");
    this.field = get("frame");
    this.frame = 0;
    this.frames = 0;
    /** @type {HTMLElement | null} element that had the focus, unless a click opened the field */
    this.before = null;
    this.button.onclick = ({ detail }) => this.open(detail > 0);
    this.field.onkeydown = (event) => this.key(event);
    this.field.oninput = () => refuse(this.field, "");
    // Some keyboards have no Enter.
    this.field.onblur = () => this.close(frameIn(this.field.value, this.frames));
  }

  /** @param {State} state */
  show({ frame, frames }) {
    this.frame = Math.round(frame);
    this.frames = frames;
    this.button.hidden = !this.field.hidden;
    this.button.textContent = this.words;
  }

  get words() {
    return `Frame ${integerText(this.frame + 1)} of ${integerText(this.frames)}`;
  }

  // With `clicked` a pointer opened the field; then the focus does not return to the button.
  open(clicked = false) {
    if (!this.frames) return;
    const { activeElement } = document;
    this.before = !clicked && activeElement instanceof HTMLElement ? activeElement : null;
    this.player.send({ do: "pause" });
    refuse(this.field, "");
    this.field.value = String(this.frame + 1);
    this.field.setAttribute("aria-label", `Frame to go to, from 1 to ${this.frames}`);
    this.field.hidden = false;
    this.button.hidden = true;
    this.field.select();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.isComposing || (event.key !== "Enter" && event.key !== "Escape")) return;
    event.preventDefault();
    event.stopPropagation();
    const frame = event.key === "Enter" ? frameIn(this.field.value, this.frames) : this.frame;
    if (frame === null) {
      refuse(this.field, `Enter a whole number from 1 to ${this.frames}.`);
      return;
    }
    this.close(frame);
    this.before?.focus();
  }

  /** @param {number | null} frame */
  close(frame) {
    if (this.field.hidden) return;
    this.button.hidden = false;
    this.field.hidden = true;
    if (frame !== null && frame !== this.frame) this.player.send({ do: "seek", frame });
  }
}

/** @typedef {"from" | "to"} End */

// The loop range on the track: two ends that pointers or keys move.
class LoopRange {
  /** @param {Playing} player */
  constructor(player) {
    this.player = player;
    this.last = 0;
    /** @type {Record<End, number>} */
    this.at = { from: 0, to: 0 };
    for (const end of /** @type {const} */ (["from", "to"])) {
      const handle = get(`range-${end}`);
      handle.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        handle.focus();
        handle.setPointerCapture(event.pointerId);
      });
      handle.addEventListener("pointermove", (event) => {
        if (handle.hasPointerCapture(event.pointerId))
          this.move(end, Math.round(shareAt(event.clientX, get("track")) * this.last));
      });
      handle.addEventListener("keydown", (event) => this.key(end, event));
    }
  }

  /** @param {State} state */
  show({ loop, from, to, frames }) {
    get("range").hidden = !loop || frames < 2;
    if (get("range").hidden) return;
    this.last = frames - 1;
    this.at = { from: Math.min(from ?? 0, this.last), to: Math.min(to ?? this.last, this.last) };
    const part = get("range-part");
    const [left, right] = [(100 * this.at.from) / this.last, 100 - (100 * this.at.to) / this.last];
    part.style.left = get("range-from").style.left = `${left}%`;
    part.style.right = get("range-to").style.right = `${right}%`;
    part.classList.toggle("whole", from === null && to === null);
    for (const end of /** @type {const} */ (["from", "to"])) {
      const handle = get(`range-${end}`);
      const frame = Math.round(this.at[end]) + 1;
      handle.setAttribute("aria-valuemax", String(frames));
      handle.setAttribute("aria-valuenow", String(frame));
      handle.setAttribute("aria-valuetext", `Frame ${frame} of ${frames}`);
    }
  }

  get words() {
    return get("range").hidden
      ? "No loop"
      : `Loop from frame ${Math.round(this.at.from) + 1} to ${Math.round(this.at.to) + 1}`;
  }

  // Move an end to a frame, at least one frame away from the other end.
  /**
   * @param {End} end
   * @param {number} frame
   */
  move(end, frame) {
    const [min, max] = end === "from" ? [0, this.at.to - 1] : [this.at.from + 1, this.last];
    this.player.send({ do: "set", [end]: Math.min(Math.max(frame, min), max) });
  }

  /**
   * @param {End} end
   * @param {KeyboardEvent} event
   */
  key(end, event) {
    const by = STEPS[event.key];
    if (by === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation(); // the playhead stays
    this.move(end, this.at[end] + (event.shiftKey ? FAR * by : by));
  }
}
