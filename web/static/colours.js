// What a module's colour says. Red alone means error, one blue alone means selected, grey means that
// nothing was recorded; all else is told by an even ramp that colour-blind people read as well.
import { newtonMetres, radians } from "./words.js";

const SAMPLES = 48; // moments that a scale is found from
const NEAR = 0.5; // pitches; modules farther apart all look alike

// The colourings there are, in the order of the menu.
export const COLOURINGS = [
  ["error", "Joint error"],
  ["error-even", "Joint error, colour-blind safe"],
  ["position", "Position error"],
  ["torque", "Torque"],
  ["speed", "Joint speed"],
  ["clearance", "Clearance"],
  ["chain", "Place in the chain"],
];

// Those that need figures.js.
export const MEASURED = new Set(["position", "torque", "clearance"]);

// Shares of a ramp (n), NaN where nothing is known, as 3n sRGB bytes.
export function ramped(shares, ramp, unknown) {
  const last = ramp.length / 3 - 1;
  const colours = new Uint8Array(3 * shares.length);
  for (let i = 0; i < shares.length; i++) {
    const share = shares[i];
    if (Number.isNaN(share)) { for (let c = 0; c < 3; c++) colours[3 * i + c] = unknown[c]; continue; }
    const k = 3 * Math.round(Math.min(1, Math.max(0, share)) * last);
    colours[3 * i] = ramp[k]; colours[3 * i + 1] = ramp[k + 1]; colours[3 * i + 2] = ramp[k + 2];
  }
  return colours;
}

// The end of a scale: 1, 2 or 5 times a power of ten.
export function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  for (const factor of [1, 2, 5, 10]) if (value <= factor * power * (1 + 1e-9)) return factor * power;
  return 10 * power;
}

const largest = (values) => values.reduce((most, v) => (v > most ? v : most), 0);

class Colouring {
  // `values` tells a figure of each module at a moment, `high` the end of the scale.
  constructor(key, film, { values, high, low = 0, ramp = "ramp_even", text, none = "not recorded", bad = null }) {
    Object.assign(this, { key, film, figures: null, values, low, high, ramp, text, none, bad });
    this.label = COLOURINGS.find(([name]) => name === key)[1];
  }

  of(shown) {
    const { header, arrays } = this.film.scenery;
    const values = this.values(shown);
    const high = typeof this.high === "function" ? this.high() : this.high;
    const colours = ramped(values.map((v) => (v - this.low) / (high - this.low)), arrays[this.ramp], header.colours.unknown);
    if (this.bad) values.forEach((v, i) => { if (this.bad(v)) colours.set(header.colours.error, 3 * i); });
    return colours;
  }

  legend() {
    const ramp = this.film.scenery.arrays[this.ramp];
    const last = ramp.length / 3 - 1;
    const stops = Array.from({ length: 9 }, (_, k) => Array.from(ramp.subarray(3 * Math.round((k / 8) * last)).slice(0, 3)).join(" "));
    const high = typeof this.high === "function" ? this.high() : this.high;
    return {
      title: this.label, low: this.text(this.low), high: this.text(high), none: this.none,
      ramp: `linear-gradient(to right, ${stops.map((stop) => `rgb(${stop})`).join(", ")})`,
    };
  }
}

// The end of a scale that fits a figure all along the film, as far as it is here.
function scaled(film, values, least = 0) {
  let most = least;
  for (let k = 0; k <= SAMPLES; k++) {
    const frame = film.nearest(Math.round((film.last * k) / SAMPLES));
    if (frame === null) continue;
    most = Math.max(most, largest(values(film.peek(frame))));
  }
  return roundUp(most);
}

export function colouring(key, film, figures) {
  const { chain } = film;
  const per = (values, text, more = {}) => new Colouring(key, film, { values, text, high: () => scale(), ...more });
  const unknown = () => new Float32Array(chain.modules).fill(NaN);
  // A scale is looked for when it is first asked for, and again while frames still come in.
  let known = null;
  const scale = (least) => {
    if (!known || known.version !== film.version) {
      known = { version: film.version, high: scaled(film, made.values, least) };
    }
    return known.high;
  };
  const makers = {
    error: () => per((shown) => film.moduleErrors(shown.errors), radians, { high: () => film.errorScale, ramp: "ramp_error" }),
    "error-even": () => per((shown) => film.moduleErrors(shown.errors), radians, { high: () => film.errorScale }),
    position: () => per((shown) => figures.row(shown.low)?.position_error ?? unknown(), (v) => `${round(v)} pitch`, {
      high: () => roundUp(figures.largest("position_error")),
    }),
    speed: () => per((shown) => film.carried(film.speeds(shown.frame), (a, b) => Math.max(Math.abs(a), Math.abs(b))), (v) => `${round(v)} rad/s`),
    torque: () => per((shown) => {
      const torques = figures.row(shown.low)?.torque;
      return torques ? film.carried(torques, (a, b) => Math.max(Math.abs(a), Math.abs(b))) : unknown();
    }, newtonMetres, { high: () => roundUp(figures.largest("torque")) }),
    clearance: () => per((shown) => figures.row(shown.low)?.clearance ?? unknown(), (v) => `${round(v)} pitch`, {
      high: NEAR, bad: (v) => v < 0, none: "not measured yet",
    }),
    chain: () => per(() => Float32Array.from({ length: chain.modules }, (_, i) => i), (v) => `Module ${Math.round(v)}`, { high: chain.modules - 1, none: null }),
  };
  const made = (makers[key] ?? makers.error)();
  made.figures = figures;
  return made;
}

export const round = (v) => Number(v.toPrecision(2));
