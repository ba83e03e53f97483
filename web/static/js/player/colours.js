// Colours of modules. Red is reserved for errors, one blue for the selection, and grey for missing
// data; all other values use a perceptually uniform ramp that is safe for colour-blind people.
import { newtonMetres, number, pitches, radians, si } from "../lib/text.js";

const SAMPLES = 48; // frames that determine the end of a scale
/** @param {string} label */
const whileFolding = (label) => `${label} exists only while folding`;
const NEAR = 0.5; // pitches; larger clearances all have the same colour

// Available colourings, in menu order.
/** @type {[key: string, label: string][]} */
export const COLOURINGS = [
  ["error", "Joint error"],
  ["error-even", "Joint error, colour-blind safe"],
  ["position", "Position error"],
  ["torque", "Torque"],
  ["joint_torque", "Torque on the table"],
  ["pressed", "Force on the table"],
  ["speed", "Joint speed"],
  ["clearance", "Clearance"],
  ["chain", "Position in the chain"],
];

// The colouring of a page whose visitor has not chosen one. It says something in every phase.
export const USUAL_COLOURING = "chain";

/** @type {[key: string, label: string]} */
const OF_MODULES = ["module", "Colours of the modules"];

// Return the colouring of such a page for a chain: modules with colours of their own show them.
/**
 * @param {string} usual
 * @param {Pick<BundleHeader, "own_colours">} header
 */
export const usualColouring = (usual, { own_colours: own }) =>
  usual === USUAL_COLOURING && own.length ? "module" : usual;

/**
 * Colourings whose values come from figures.js, and the names of these values.
 * @type {Record<string, FigureName>}
 */
export const MEASURED = {
  position: "position_error",
  torque: "torque",
  joint_torque: "joint_torque",
  pressed: "pressed",
  clearance: "clearance",
};
const ON_TABLE = new Set(["joint_torque", "pressed"]);
const OF_HINGES = new Set(["torque", "joint_torque"]);
const FLOATING = new Set(["torque"]); // only in zero gravity
// Long folds have only the values of the whole chain; the plots show them.
const WHOLE_CHAIN = new Set(["torque", "clearance"]);

// Return the colourings of a fold in zero gravity or on a table, whose modules have colours or not.
/**
 * @param {boolean} table
 * @param {Pick<BundleHeader, "own_colours">} [header]
 */
export const colouringsOf = (table, header) => [
  ...(header?.own_colours.length ? [OF_MODULES] : []),
  ...COLOURINGS.filter(([key]) => !(table ? FLOATING : ON_TABLE).has(key)),
];

// Return the colours (3n sRGB bytes) of n fractions of a ramp; NaN means no data.
/**
 * @param {Numbers} shares
 * @param {Uint8Array} ramp
 * @param {Colour} unknown
 */
export function ramped(shares, ramp, unknown) {
  const last = ramp.length / 3 - 1;
  const colours = new Uint8Array(3 * shares.length);
  for (let i = 0; i < shares.length; i++) {
    const share = shares[i];
    if (Number.isNaN(share)) {
      for (let c = 0; c < 3; c++) colours[3 * i + c] = unknown[c];
      continue;
    }
    const k = 3 * Math.round(Math.min(1, Math.max(0, share)) * last);
    colours[3 * i] = ramp[k];
    colours[3 * i + 1] = ramp[k + 1];
    colours[3 * i + 2] = ramp[k + 2];
  }
  return colours;
}

const largest = (/** @type {Floats} */ values) =>
  Array.from(values).reduce((max, v) => (v > max ? v : max), 0);

/**
 * Definition of a colouring.
 * @typedef {object} Scale
 * @property {(shown: Snapshot) => Floats} values
 * @property {number | (() => number)} high
 * @property {number} [low]
 * @property {"ramp_even" | "ramp_error"} [ramp]
 * @property {(value: number) => string} text
 * @property {string | null} [none] meaning of missing values
 * @property {(value: number) => boolean} [bad] true for values in the colour of errors
 */

/**
 * A scale as the legend shows it.
 * @typedef {{ low: string, high: string, ramp: string, missing: "none" | "some" | "all",
 *   none: string | null }} LegendShown
 */

/** @typedef {Pick<import("./figures.js").Figures, "row" | "largest" | "plots">} Measured */

// Return true if the values of a colouring are available.
/**
 * @param {string} key
 * @param {Pick<import("./timeline.js").Timeline, "windowed">} timeline
 * @param {Pick<import("./figures.js").Figures, "offers">} figures
 */
export const isOffered = (key, timeline, figures) =>
  !(key in MEASURED) ||
  (figures.offers(MEASURED[key]) && !(timeline.windowed && WHOLE_CHAIN.has(key)));

export class Colouring {
  // How many modules had no value at the moment of the last call of `of`: "none", "some" or "all".
  // If no module has one, the colours show the positions in the chain; single ones are grey.
  /** @type {"none" | "some" | "all"} */
  missing = "none";

  // `scale.values` returns one value of each module at
  // a moment; `scale.high` is the end of the scale.
  /**
   * @param {string} key
   * @param {import("./timeline.js").Timeline} timeline
   * @param {Scale} scale
   */
  constructor(key, timeline, scale) {
    this.key = key;
    this.timeline = timeline;
    /** @type {Measured | null} */
    this.figures = null;
    /** @type {Required<Scale>} */
    this.scale = {
      low: 0,
      ramp: "ramp_even",
      none: "no data for this frame",
      bad: () => false,
      ...scale,
    };
  }

  // Return true unless the values of a moment are still loading.
  /** @param {Pick<Snapshot, "low">} snapshot */
  isLoaded({ low }) {
    const { figures, key } = this;
    if (!(key in MEASURED) || !figures?.plots || low >= figures.plots.frames) return true;
    return figures.row(low) !== null;
  }

  get high() {
    const { high } = this.scale;
    return typeof high === "function" ? high() : high;
  }

  /**
   * @param {Snapshot} snapshot
   * @returns {Uint8Array}
   */
  of(snapshot) {
    const { header, arrays } = this.timeline.bundle;
    const {
      high,
      scale: { low, ramp, bad },
    } = this;
    const values = this.scale.values(snapshot);
    const unknown = Array.from(values).filter(Number.isNaN).length;
    this.missing = !unknown ? "none" : unknown < values.length ? "some" : "all";
    if (this.missing === "all") return usualOf(this.timeline).of(snapshot);
    const colours = ramped(
      values.map((v) => (v - low) / (high - low || 1)),
      arrays[ramp],
      header.colours.unknown,
    );
    values.forEach((v, i) => {
      if (bad(v)) colours.set(header.colours.error, 3 * i);
    });
    return colours;
  }

  /** @returns {LegendShown} */
  legend() {
    const { low, text } = this.scale;
    const { missing } = this;
    const none = missing === "none" ? null : this.scale.none;
    if (missing === "all") return { ...usualOf(this.timeline).legend(), missing, none };
    const ramp = this.timeline.bundle.arrays[this.scale.ramp];
    const last = ramp.length / 3 - 1;
    const stops = Array.from({ length: 9 }, (_, k) =>
      Array.from(ramp.subarray(3 * Math.round((k / 8) * last)).slice(0, 3)).join(" "),
    );
    return {
      low: text(low),
      high: text(this.high),
      missing,
      none,
      ramp: `linear-gradient(to right, ${stops.map((stop) => `rgb(${stop})`).join(", ")})`,
    };
  }
}

// The colours that the module's file names, in turn; they have no scale.
class OwnColours extends Colouring {
  of() {
    const { own_colours: own } = this.timeline.bundle.header;
    const { modules } = this.timeline.chain;
    return Uint8Array.from(
      { length: 3 * modules },
      (_, k) => own[Math.floor(k / 3) % own.length][k % 3],
    );
  }

  legend() {
    const { own_colours: own } = this.timeline.bundle.header;
    const bands = own.map((colour, k) => {
      const [from, to] = [k, k + 1].map((edge) => `${((100 * edge) / own.length).toFixed(2)}%`);
      return `rgb(${colour.join(" ")}) ${from} ${to}`;
    });
    return {
      low: "",
      high: "",
      missing: this.missing,
      none: null,
      ramp: `linear-gradient(to right, ${bands.join(", ")})`,
    };
  }
}

// Return the colouring by the position in the chain, which has a value at every moment.
/** @param {import("./timeline.js").Timeline} timeline */
const byChain = (timeline) =>
  new Colouring(USUAL_COLOURING, timeline, {
    values: () => Float32Array.from({ length: timeline.chain.modules }, (_, i) => i),
    text: (v) => `Module ${Math.round(v) + 1}`,
    high: timeline.chain.modules - 1,
    none: null,
  });

// Return the colouring by the modules' own colours; by the position in the chain if they have none.
/**
 * @param {import("./timeline.js").Timeline} timeline
 * @returns {Colouring}
 */
const usualOf = (timeline) =>
  timeline.bundle.header.own_colours.length
    ? new OwnColours("module", timeline, {
        values: () => new Float32Array(timeline.chain.modules),
        text: () => "",
        high: 1,
      })
    : byChain(timeline);

// Return the largest value in the loaded frames of the timeline, at which a scale ends.
/**
 * @param {import("./timeline.js").Timeline} timeline
 * @param {(shown: Snapshot) => Floats} values
 */
function scaled(timeline, values) {
  let max = 0;
  for (let k = 0; k <= SAMPLES; k++) {
    const frame = timeline.nearest(Math.round((timeline.last * k) / SAMPLES));
    const snapshot = frame === null ? null : timeline.peek(frame);
    if (snapshot) max = Math.max(max, largest(values(snapshot)));
  }
  return max || 1;
}

/**
 * @param {string} key
 * @param {import("./timeline.js").Timeline} timeline
 * @param {Measured | null | undefined} figures
 */
export function colouringFor(key, timeline, figures) {
  const { chain } = timeline;
  /**
   * @param {Scale["values"]} values
   * @param {Scale["text"]} text
   * @param {Partial<Scale>} options
   */
  const per = (values, text, options = {}) =>
    new Colouring(key, timeline, { values, text, high: () => scale(), ...options });
  // Computed on first use, and again after new frames.
  let [high, version] = [0, -1];
  const scale = () => {
    if (version !== timeline.version)
      [high, version] = [scaled(timeline, selected.scale.values), timeline.version];
    return high;
  };
  const errors = (/** @type {Snapshot} */ snapshot) => timeline.perModule(snapshot.errors);
  /**
   * @param {FigureName} name
   * @param {Scale["text"]} valueText
   * @param {Partial<Scale>} options
   */
  const measured = (name, valueText, options = {}) =>
    per(
      (snapshot) => {
        const values = figures?.row(snapshot.low)?.[name];
        if (!values) return new Float32Array(chain.modules).fill(NaN);
        return OF_HINGES.has(name) ? timeline.perModule(values) : values;
      },
      valueText,
      { high: () => figures?.largest(name) || 1, ...options },
    );
  /** @type {Record<string, () => Colouring>} */
  const makers = {
    error: () =>
      per(errors, radians, {
        high: () => timeline.errorScale,
        ramp: "ramp_error",
        none: whileFolding("Joint error"),
      }),
    "error-even": () =>
      per(errors, radians, { high: () => timeline.errorScale, none: whileFolding("Joint error") }),
    position: () => measured("position_error", pitches, { none: whileFolding("Position error") }),
    speed: () =>
      per(
        (snapshot) => timeline.perModule(timeline.speeds(snapshot.frame)),
        (v) => si(v, "rad/s"),
      ),
    torque: () => measured("torque", newtonMetres),
    joint_torque: () =>
      measured("joint_torque", (v) => withUnit(v, figures?.plots?.table?.unit_nm ?? 0), {
        none: "not computed for this frame",
      }),
    pressed: () =>
      measured("pressed", (v) => (v ? `${number(v)} × the module’s weight` : "0"), {
        none: "not computed for this frame",
      }),
    clearance: () => measured("clearance", pitches, { high: NEAR, bad: (v) => v < 0 }),
    chain: () => byChain(timeline),
    module: () => usualOf(timeline),
  };
  const selected = (makers[key] ?? makers[USUAL_COLOURING])();
  selected.figures = figures ?? null;
  return selected;
}

// Return a torque as text: in module weight × pitch, and in N·m.
/**
 * @param {number} torque
 * @param {number} unit_nm
 */
export const withUnit = (torque, unit_nm) =>
  torque ? `${number(torque)} w·p, ${newtonMetres(torque * unit_nm)}` : "0";
