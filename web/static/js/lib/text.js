// Formatting of numbers and stages, and other common helpers: elements, storage, lazy loading.
/** @type {Record<string, string>} */
export const STAGES = {
  read: "Preparing",
  explode: "Unfolding",
  play_back: "Folding",
  certify: "Checking clearance",
  export: "Writing the files",
};

/** @param {number} value */
export const integerText = (value) =>
  Math.round(value).toLocaleString("en").replaceAll(",", "\u2009");

// Return a number of modules with what they are called.
/**
 * @param {number} count
 * @param {Api.ModuleWordsBody} words
 */
export const countedText = (count, { singular, plural }) =>
  `${integerText(count)} ${count === 1 ? singular : plural}`;

// A share as a whole percentage, as in words/likeness.py: one above 0 is never 0 %, one below 1
// never 100 %.
/** @param {number} share */
export function percent(share) {
  if (share > 0 && share < 0.01) return "less than 1\u00a0%";
  return `${share < 1 ? Math.min(99, Math.round(100 * share)) : 100}\u00a0%`;
}

// `SI_PREFIXES` of words/quantities.py, by their power of ten; `si` there gives the same texts.
/** @type {Record<number, string>} */
const SI_PREFIXES = { [-12]: "p", [-9]: "n", [-6]: "µ", [-3]: "m", 0: "", 3: "k" };
const [MIN_POWER, MAX_POWER] = [-12, 3];
const DIGITS = 2;
const WHOLE_BELOW = 1e6;

// Return a quantity with an SI prefix: 34 µN·m, 0 rad, < 1 pN·m.
/**
 * @param {number} value
 * @param {string} unit
 * @param {number} digits
 */
export function si(value, unit, digits = DIGITS) {
  if (value === 0) return `0 ${unit}`;
  const [mantissa, exponent] = Math.abs(value)
    .toExponential(digits - 1)
    .split("e")
    .map(Number);
  const power = Math.min(3 * Math.floor(exponent / 3), MAX_POWER);
  if (power < MIN_POWER) return `< 1 ${SI_PREFIXES[MIN_POWER]}${unit}`;
  const scaled = Number(`${mantissa}e${exponent - power}`);
  return `${value < 0 ? "−" : ""}${scaled} ${SI_PREFIXES[power]}${unit}`;
}

// Return a number with some significant digits, as `number`
// of words/quantities.py: 0.0038, 30000, 1.3×10⁻¹².
/**
 * @param {number} value
 * @param {number} digits
 * @returns {string}
 */
export function number(value, digits = DIGITS) {
  if (value < 0) return `−${number(-value, digits)}`;
  const [mantissa, exponent] = value
    .toExponential(digits - 1)
    .split("e")
    .map(Number);
  if (value === 0 || (exponent >= -4 && exponent < digits))
    return String(Number(value.toPrecision(digits)));
  if (value >= 1 && value < WHOLE_BELOW) return String(Math.round(value));
  const raised = Array.from(String(exponent), (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
  return `${mantissa}×10${raised.join("")}`;
}

/** @param {number} value */
export const pitches = (value) => `${number(value)} pitch`;

/** @param {number | null | undefined} value */
export const radians = (value) =>
  value === null || value === undefined ? "no data for this frame" : si(value, "rad");

/** @param {number} value */
export const newtonMetres = (value) => si(value, "N·m");

/** @param {string} text */
export const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

// Return the message of a thrown error.
/** @param {unknown} error */
export const wordsOf = (error) => (error instanceof Error ? error.message : String(error));

/** @param {number} value in seconds */
export function duration(value) {
  if (value < 90) return `about ${Math.max(1, Math.round(value))} s`;
  if (value < 5400) return `about ${Math.round(value / 60)} min`;
  return `about ${Math.round(value / 3600)} h`;
}

/** @param {number} value */
export const seconds = (value) => `${value.toFixed(2)} s`;

// Return the element of the page with an id; types.d.ts lists those of specific types.
/**
 * @template {string} Id
 * @param {Id} id
 */
export const get = (id) =>
  /** @type {ElementOf<Id>} */ (/** @type {unknown} */ (document.getElementById(id)));

// Return the address of a path of the service, which may itself be below a path of its host.
/** @param {string} path */
export const at = (path) => `${globalThis.document?.documentElement?.dataset?.base ?? ""}${path}`;

// Create an element. Attribute values that start with "/" are paths of the service.
/**
 * @template {keyof HTMLElementTagNameMap} Name
 * @param {Name} name
 * @param {Record<string, string | number | boolean | null | undefined>} attributes
 * @param {(Node | string | null)[]} children
 */
export function element(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false)
      node.setAttribute(
        key,
        value === true ? "" : String(value).startsWith("/") ? at(String(value)) : String(value),
      );
  }
  node.append(...children.filter((child) => child !== null));
  return node;
}

// Return a button with a click handler.
/**
 * @param {string} look
 * @param {string} text
 * @param {() => void} press
 * @param {Parameters<typeof element>[1]} attributes
 */
export function button(look, text, press, attributes = {}) {
  const control = element("button", { type: "button", class: look, ...attributes }, text);
  control.onclick = press;
  return control;
}

// Return an SVG element with children or text.
/**
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {(SVGElement | string)[]} children
 */
export function svg(name, attributes = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, String(value));
  node.append(...children);
  return node;
}

/**
 * @typedef {"localStorage" | "sessionStorage"} StorageArea of the browser, or of the tab until it
 *   is closed
 */

// Return the stored value of a name; null if there is none or storage is refused.
/**
 * @param {string} name
 * @param {StorageArea} area
 */
export function stored(name, area = "localStorage") {
  try {
    return globalThis[area].getItem(name);
  } catch {
    return null;
  }
}

// Store a value, null to remove it. Return false if storage is full or refused.
/**
 * @param {string} name
 * @param {string | null} value
 * @param {StorageArea} area
 */
export function store(name, value, area = "localStorage") {
  try {
    if (value === null) globalThis[area].removeItem(name);
    else globalThis[area].setItem(name, value);
    return true;
  } catch {
    return false;
  }
}

// Return true if a click on a link opens it in another tab or window, or saves it.
/** @param {MouseEvent} event */
export const opensElsewhere = ({ ctrlKey, metaKey, shiftKey, altKey }) =>
  ctrlKey || metaKey || shiftKey || altKey;

export const UNREACHABLE = "The server cannot be reached. Check the connection and try again.";

// Return a function that loads a part on first use and returns the
// result of the given callback. If loading fails, it calls `refused`
// with the reason and returns undefined; the next use tries again.
// A script that cannot be fetched is reported as a TypeError.
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
    } catch (error) {
      loading = null;
      refused(error instanceof TypeError ? UNREACHABLE : wordsOf(error));
      return undefined;
    }
    return use(part);
  };
}

const KEPT_MS = 60_000; // lifetime of the object URL

// Save a file to the visitor's disk.
/**
 * @param {Blob} file
 * @param {string} name
 */
export function save(file, name) {
  const href = URL.createObjectURL(file);
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), KEPT_MS);
}

const TOAST_MS = 2600;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let toastTimer;

// Show a message for a moment.
/** @param {string} text */
export function toast(text) {
  const line = get("toast");
  line.textContent = text;
  line.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => {
    line.hidden = true;
  }, TOAST_MS);
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
