// Numbers and stages in words, and what else most scripts use: elements, events, parts loaded later.
/** @type {Record<string, string>} */
export const PHASES = { explosion: "Explosion", unfolding: "Unfolding", playback: "Playback" };

/** @type {Record<string, string>} */
export const STAGES = {
  read: "Reading the input",
  explode: "Exploding",
  play_back: "Playing back",
  certify: "Checking clearance",
  export: "Writing the plan",
};

/** @param {number} value */
export function whole(value) {
  return Math.round(value).toLocaleString("en").replaceAll(",", "\u2009");
}

// `SI_PREFIXES` of server/pages/quantities.py, by their power of ten; `si` there gives the same texts.
/** @type {Record<number, string>} */
const SI_PREFIXES = { [-12]: "p", [-9]: "n", [-6]: "µ", [-3]: "m", 0: "", 3: "k" };
const [MIN_POWER, MAX_POWER] = [-12, 3];
const DIGITS = 2;
const WHOLE_BELOW = 1e6;

// A quantity with an SI prefix: 34 µN·m, 0 rad, < 1 pN·m.
/**
 * @param {number} value
 * @param {string} unit
 * @param {number} digits
 */
export function si(value, unit, digits = DIGITS) {
  if (value === 0) return `0 ${unit}`;
  const [mantissa, exponent] = Math.abs(value).toExponential(digits - 1).split("e").map(Number);
  const power = Math.min(3 * Math.floor(exponent / 3), MAX_POWER);
  if (power < MIN_POWER) return `< 1 ${SI_PREFIXES[MIN_POWER]}${unit}`;
  return `${value < 0 ? "−" : ""}${Number(`${mantissa}e${exponent - power}`)} ${SI_PREFIXES[power]}${unit}`;
}

// A number with so many significant digits, as `number` of server/pages/quantities.py gives it: 0.0038, 30000, 1.3×10⁻¹².
/**
 * @param {number} value
 * @param {number} digits
 * @returns {string}
 */
export function number(value, digits = DIGITS) {
  if (value < 0) return `−${number(-value, digits)}`;
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e").map(Number);
  if (value === 0 || (exponent >= -4 && exponent < digits)) return String(Number(value.toPrecision(digits)));
  if (value >= 1 && value < WHOLE_BELOW) return String(Math.round(value));
  return `${mantissa}×10${String(exponent).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)])}`;
}

/** @param {number} value */
export const pitches = (value) => `${number(value)} pitch`;

/** @param {number | null | undefined} value */
export function radians(value) {
  return value === null || value === undefined ? "no data in this phase" : si(value, "rad");
}

/** @param {number} value */
export const newtonMetres = (value) => si(value, "N·m");

/**
 * @param {number} value
 * @param {number} digits
 */
export function degrees(value, digits = 1) {
  const shown = ((value * 180) / Math.PI).toFixed(digits);
  return `${Number(shown) === 0 ? (0).toFixed(digits) : shown}°`.replace("-", "−");
}

/** @param {string} text */
export function sentence(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

const NUMBERED_PARTS = /\b(?:module|cell|angle|triangle)s? \d+\b(?:(?:, | and | to | against )\d+\b)*(?: more)?/gi;

// A text of the planner, which counts modules and cells from 0, counting from 1: `count_from_one` of server/pages/failures.py.
/** @param {string} text */
export const countFromOne = (text) => text.replace(NUMBERED_PARTS, (named) => named.replace(/\d+(?! more)\b/g, (index) => String(Number(index) + 1)));

// What an error that was thrown says.
/** @param {unknown} error */
export const wordsOf = (error) => (error instanceof Error ? error.message : String(error));

// What the server said, as a sentence that also says where.
/**
 * @param {Refused} told
 * @param {number} status
 */
export function refusal(told, status) {
  const text = countFromOne(told.message ?? told.detail ?? `The server answered ${status}.`);
  const where = countFromOne(told.where ?? "");
  const said = text.includes(where) || text.includes(where.replaceAll("_", " "));
  return sentence(said ? text : `${where}: ${text}`);
}

/** @param {number} value in seconds */
export function duration(value) {
  if (value < 90) return `about ${Math.max(1, Math.round(value))} s`;
  if (value < 5400) return `about ${Math.round(value / 60)} min`;
  return `about ${Math.round(value / 3600)} h`;
}

// How long ago or from now, in whole minutes, hours or days.
/** @param {number} value in seconds */
export function span(value) {
  if (value < 90 * 60) return `${Math.max(1, Math.round(value / 60))}\u00a0min`;
  if (value < 36 * 3600) return `${Math.round(value / 3600)}\u00a0h`;
  return `${Math.round(value / 86400)}\u00a0days`;
}

const FEW_S = 5;

// What is left of something, as the service estimates it.
/** @param {number} value in seconds; 0 when it takes longer than usual */
export function remaining(value) {
  if (value <= 0) return "longer than usual";
  return value < FEW_S ? "a few seconds left" : `${duration(value < 20 ? value : 5 * Math.round(value / 5))} left`;
}

/** @param {number} value in bytes */
export function megabytes(value) {
  return `${(value / 1e6).toFixed(value < 1e7 ? 1 : 0)} MB`;
}

/** @param {number} value */
export function seconds(value) {
  return `${value.toFixed(2)} s`;
}

// The element of the page with an id; types.d.ts lists those that are more than an element.
/**
 * @template {string} Id
 * @param {Id} id
 */
export const get = (id) => /** @type {ElementOf<Id>} */ (/** @type {unknown} */ (document.getElementById(id)));

/**
 * @template {keyof HTMLElementTagNameMap} Name
 * @param {Name} name
 * @param {Record<string, string | number | boolean | null | undefined>} attributes
 * @param {(Node | string | null)[]} children
 */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? "" : String(value));
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

// Something that tells what is: events with a name and a detail.
export class Emitter extends EventTarget {
  /**
   * @param {string} name
   * @param {unknown} [detail]
   */
  tell(name, detail = null) { this.dispatchEvent(new CustomEvent(name, { detail })); }

  /**
   * @template Told
   * @param {string} name
   * @param {(detail: Told) => void} heard
   */
  on(name, heard) { this.addEventListener(name, (event) => heard(/** @type {CustomEvent<Told>} */ (event).detail)); }
}

export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// Something that is loaded when it is first used; what is made of it comes back. Where that fails,
// `refused` is told why, nothing comes back, and the next use tries again.
/**
 * @template Part
 * @param {() => Promise<Part>} load
 * @param {(text: string) => void} refused
 * @returns {<Made>(use: (part: Part) => Made | Promise<Made>) => Promise<Made | undefined>}
 */
export function later(load, refused) {
  /** @type {Promise<Part> | null} */
  let loading = null;
  return async (use) => {
    let part;
    try {
      part = await (loading ??= load());
    } catch {
      loading = null;
      refused(UNREACHABLE);
      return undefined;
    }
    return use(part);
  };
}

/**
 * @param {string} text
 * @param {() => void} done
 * @param {() => void} refused
 */
export async function copyText(text, done, refused) {
  try {
    await navigator.clipboard.writeText(text);
    done();
  } catch {
    refused();
  }
}
