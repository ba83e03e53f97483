// Reading of the visitor's own module values from CSV or JSON; see docs/links.md.

export const MAX_FILE_BYTES = 20 * 2 ** 20;
const FORMAT = "foldback-values/1";
/**
 * Maximum number of values that a service stores with a fold, as in planner/plan/module_values.py.
 */
const MAX_KEPT = 45_000;
const MAX_NAME = 80;
const LEVELS = 254; // quantisation levels from minimum to maximum; the next level means no value
const NONE = LEVELS + 1;
const NOTHING = /^(|nan|na|n\/a|null|none|-|[+-]?inf(inity)?)$/i;
const NAMED = /^(.*?)\s*[([]([^()[\]]{1,20})[)\]]$/; // Temperature (°C)

/**
 * @typedef {object} OwnValues
 * @property {string} name
 * @property {string} unit
 * @property {number} rows of values; 1, or several, spread evenly over the frames
 * @property {Float32Array} values rows × modules; NaN for no value
 * @property {number} low
 * @property {number} high
 * @typedef {{ modules: number, frames: number }} Counts frames are 0 while their number is unknown
 * @typedef {{ rows: number[][], header: string[], places: number[] }} Cells `places` are the lines
 *   of the rows
 */

// Parse a text into rows of numbers and a header.
/**
 * @param {string} text
 * @returns {Cells}
 */
function cellsOf(text) {
  const lines = text.trimEnd().split(/\r\n|\n|\r/);
  // If only some lines have a comma, it is a decimal comma.
  const [first = "", ...below] = lines.filter((line) => line.trim());
  const mayBeDecimal = (/** @type {string} */ line) => /^[^,]*(,\d+)?$/.test(line.trim());
  const decimal =
    below.every(mayBeDecimal) &&
    below.some((line) => !line.includes(",")) &&
    (mayBeDecimal(first) || below.some((line) => line.includes(",")));
  const separator =
    [";", "\t", ...(decimal ? [] : [","])].find((mark) => text.includes(mark)) ?? / +/;
  const read = (/** @type {string} */ cell) => {
    if (NOTHING.test(cell)) return NaN;
    const number = Number(separator === "," ? cell : cell.replace(",", "."));
    return Number.isNaN(number) ? null : number;
  };
  const numbers = (/** @type {string} */ line) =>
    line
      .trim()
      .split(separator)
      .map((cell) => read(cell.trim()));
  const several =
    below.some((line) => numbers(line).length > 1) ||
    (numbers(first).length > 1 && !numbers(first).includes(null));
  /** @type {Cells} */
  const parsed = { rows: [], header: [], places: [] };
  /** @type {Error | null} */
  let unread = null; // about the first line that is no numbers
  lines.forEach((line, k) => {
    if (several && !line.trim()) return;
    const cells = (
      !several ? [line] : (typeof separator === "string" ? line : line.trim()).split(separator)
    ).map((cell) =>
      cell
        .trim()
        .replace(/^"(.*)"$/, "$1")
        .trim(),
    );
    const row = cells.map(read);
    const wrong = row.indexOf(null);
    if (line.startsWith("#")) {
      parsed.header = [line.replace(/^#\s*/, "")];
      return;
    }
    if (wrong >= 0) {
      const error = new Error(
        `Line ${k + 1}: "${cells[wrong].slice(0, 40)}" is not a number. Leave the field empty if ` +
          `a value is missing.`,
      );
      if (parsed.rows.length) throw error;
      unread ??= error;
      parsed.header = cells;
      return;
    }
    parsed.rows.push(/** @type {number[]} */ (row));
    parsed.places.push(k + 1);
  });
  if (unread && !parsed.rows.length) throw unread;
  return parsed;
}

// Parse JSON: a list of numbers, a list of lists, or either in an object with a name and a unit.
/**
 * @param {string} text
 * @returns {{ data: Record<string, unknown>, cells: Cells }}
 */
function jsonOf(text) {
  let data;
  try {
    data = JSON.parse(text.replace(/\bNaN\b|-?\bInfinity\b/g, "null")); // written by Python
  } catch (error) {
    throw new Error(`The file is not valid JSON: ${/** @type {Error} */ (error).message}.`, {
      cause: error,
    });
  }
  if (Array.isArray(data)) data = { values: data };
  const { values } = data;
  if (data.format !== FORMAT && !Array.isArray(values))
    throw new Error(
      'This JSON file has no list of numbers. Use a list, or an object with "values", "name" and ' +
        '"unit".',
    );
  const rows = (Array.isArray(values) ? (Array.isArray(values[0]) ? values : [values]) : []).map(
    (row, k) => {
      if (!Array.isArray(row))
        throw new Error(
          `Value ${k + 1}: ${JSON.stringify(row)?.slice(0, 40)} is not a list of numbers, but ` +
            `the first value is a list.`,
        );
      return row.map((/** @type {unknown} */ value, /** @type {number} */ i) => {
        if (typeof value === "number") return value;
        if (value === null || (typeof value === "string" && NOTHING.test(value))) return NaN;
        throw new Error(
          `Value ${i + 1}: ${JSON.stringify(value).slice(0, 40)} is not a number. Use null if a ` +
            `value is missing.`,
        );
      });
    },
  );
  return { data, cells: { rows, header: [], places: rows.map((_, k) => k + 1) } };
}

const counts = (/** @type {number[]} */ row) =>
  row.length > 2 &&
  [-1, 0, 1].some((from) =>
    row.every((value, i) => value === i + from || (i === 0 && Number.isNaN(value))),
  );
const rises = (/** @type {number[][]} */ rows) =>
  rows.every(([first], k) => k === 0 || first > rows[k - 1][0]);

// Return the values from rows of module number and value;
// numbers start at 0 if there is a 0, otherwise at 1.
/**
 * @param {Cells} cells
 * @param {number} modules
 */
function byNumber({ rows, places }, modules) {
  const from = rows.some(([module]) => module === 0) ? 0 : 1;
  const row = new Array(modules).fill(NaN);
  const listed = new Set();
  rows.forEach(([module, value], k) => {
    if (!Number.isInteger(module) || module < from || module >= modules + from)
      throw new Error(
        `Line ${places[k]}: there is no module ${module}. Module numbers go from ${from} to ` +
          `${modules + from - 1}.`,
      );
    if (listed.has(module))
      throw new Error(
        `Line ${places[k]}: module ${module} appears twice. List each module once. If your ` +
          `numbers have decimal commas, replace these commas with points.`,
      );
    listed.add(module);
    row[module - from] = value;
  });
  return [row];
}

// Return rows with one value for each module: one row, or one for each frame.
/**
 * @param {Cells} cells
 * @param {Counts} expected
 */
function arranged(cells, { modules, frames }) {
  let { rows } = cells;
  const width = rows[0]?.length ?? 0;
  const odd = rows.findIndex((row) => row.length !== width);
  if (odd >= 0)
    throw new Error(
      `Line ${cells.places[odd]}: this line has ${rows[odd].length} values, but the lines before ` +
        `it have ${width}.`,
    );
  if (![1, modules, frames].includes(width) && rows.every((row) => Number.isNaN(row.at(-1))))
    rows = rows.map((row) => row.slice(0, -1));
  if (rows[0]?.length === 1 && rows.length === modules) return [rows.flat()];
  if (rows[0]?.length === 2 && modules !== 2 && rows.length <= modules)
    return byNumber(cells, modules);
  // The first row may contain module numbers, and the first column frame numbers.
  const below = counts(rows[0] ?? []) ? rows.slice(1) : rows;
  for (const candidate of [
    rows,
    below,
    ...(rises(below) ? [rows, below].map((all) => all.map((row) => row.slice(1))) : []),
  ]) {
    const wide = candidate[0]?.length ?? 0;
    if (wide === modules && (candidate.length === 1 || candidate.length === frames))
      return candidate;
    if (candidate.length === modules && wide === frames)
      return Array.from({ length: frames }, (_, frame) => candidate.map((row) => row[frame]));
  }
  const perFrame = frames
    ? `, or ${frames} rows of ${modules} numbers, one row for each frame`
    : "";
  throw new Error(
    `This file has ${rows.length} ${rows.length === 1 ? "row" : "rows"} with ` +
      `${width} ${width === 1 ? "number" : "numbers"} each. This fold needs ${modules} numbers, ` +
      `one for each module${perFrame}. Check that the file belongs to this fold.`,
  );
}

/**
 * @param {string} text
 * @returns {[name: string, unit: string]}
 */
function named(text) {
  const [, name = text, unit = ""] = NAMED.exec(text.trim()) ?? [];
  return [name.trim().slice(0, MAX_NAME), unit];
}

// Read a file; throw an Error with a sentence for the visitor if it is invalid.
/**
 * @param {string} text
 * @param {string} file its name
 * @param {Counts} expected
 * @returns {OwnValues}
 */
export function readValues(text, file, expected) {
  const clean = text.replace(/^\uFEFF/, "");
  const { data, cells } = /^\s*[[{]/.test(clean)
    ? jsonOf(clean)
    : { data: /** @type {Record<string, unknown>} */ ({}), cells: cellsOf(clean) };
  if (data.format === FORMAT) return unpacked(/** @type {any} */ (data), expected.modules);
  const rows = arranged(cells, expected);
  const { header } = cells;
  const above = header.length <= 2 ? header.findLast(Boolean) : "";
  const [name, unit] = named(
    typeof data.name === "string" && data.name ? data.name : above || file.replace(/\.[^.]*$/, ""),
  );
  const values = Float32Array.from(rows.flat(), (value) => (Number.isFinite(value) ? value : NaN));
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) throw new Error("This file contains no numbers.");
  return {
    name: name || "Numbers from a file",
    unit: typeof data.unit === "string" ? data.unit.slice(0, 20) : unit,
    rows: rows.length,
    values,
    low,
    high,
  };
}

// Return the number of rows that can be stored with a fold.
/** @param {OwnValues} own */
export const keptRows = ({ rows, values }) =>
  Math.min(rows, Math.max(1, Math.floor((MAX_KEPT * rows) / values.length)));

// Pack values for storage with a fold, quantised between
// minimum and maximum. Surplus rows are dropped evenly.
/**
 * @param {OwnValues} ownValues
 * @returns {KeptValues}
 */
export function packed(ownValues) {
  const { name, unit, rows, values, low, high } = ownValues;
  const modules = values.length / rows;
  const keptCount = keptRows(ownValues);
  let data = "";
  for (let row = 0; row < keptCount; row++) {
    const from = modules * (keptCount === 1 ? 0 : Math.round((row / (keptCount - 1)) * (rows - 1)));
    for (let i = 0; i < modules; i++) {
      const value = values[from + i];
      data += String.fromCharCode(
        Number.isNaN(value) ? NONE : Math.round((LEVELS * (value - low)) / (high - low || 1)),
      );
    }
  }
  return { format: FORMAT, name, unit, low, high, rows: keptCount, data: btoa(data) };
}

/**
 * @param {KeptValues} kept
 * @param {number} modules
 * @returns {OwnValues}
 */
export function unpacked({ name, unit, low, high, rows, data }, modules) {
  let levels = "";
  try {
    levels = atob(data);
  } catch {}
  if (!(rows >= 1) || levels.length !== rows * modules || !(low <= high))
    throw new Error(
      `These are the values of another fold. This fold needs ${modules} values in each row.`,
    );
  const values = Float32Array.from(levels, (level) =>
    level.charCodeAt(0) === NONE ? NaN : low + (level.charCodeAt(0) / LEVELS) * (high - low),
  );
  return { name: String(name), unit: String(unit), rows, values, low, high };
}

// Return the values of all modules at a fraction of the
// frames, 0 to 1, interpolated if both rows have a value.
/**
 * @param {OwnValues} own
 * @param {number} share
 */
export function valuesAt({ rows, values }, share) {
  const modules = values.length / rows;
  const at = Math.min(1, Math.max(0, share)) * (rows - 1);
  const [low, part] = [Math.floor(at), at % 1];
  const before = values.slice(low * modules, (low + 1) * modules);
  if (!part) return before;
  return before.map((value, i) => {
    const next = values[(low + 1) * modules + i];
    return Number.isNaN(next) || Number.isNaN(value)
      ? part < 0.5
        ? value
        : next
      : value + part * (next - value);
  });
}
