// State of a preview page, without the page: the options,
// their report, and the values derived from both.
import { countedText, duration, percent, sentence, integerText } from "../lib/text.js";

/** Minimum number of modules that the service folds. */
const MIN_MODULES = 8;
const SLIDER_STEPS = 1000;
/** @typedef {"module" | "method" | "ends" | "world"} ChoiceName */
/**
 * @typedef {Record<ChoiceName, string[]>} Choices available values, the default of the page first
 */
/**
 * @typedef {Record<ChoiceName, string> & { modules: number | null, repair: boolean,
 *   as_voxels: boolean, start: string | null, seed: number, threshold: number | null,
 *   inside_out: boolean, thickness: number | null }} PreviewOptions
 */
/**
 * @typedef {{ text: string, primary?: boolean, change: Partial<PreviewOptions> }} Offer a button
 *   and the options that it changes
 */
/**
 * @typedef {{ id: string, most_modules: number, table_modules: number, path_modules: string[],
 *   next_scripts: string[], origin: { fold?: string, shape?: string },
 *   options: Record<string, string> }} PreviewFacts
 *   without an id, the input is that of `origin`; `options` are its options; `path_modules` are the
 *   names of the modules whose chains can follow each path through cells
 */

/** Options that may change the cells and thus invalidate the start cell. @type {Set<string>} */
const RESHAPING = new Set([
  ...["module", "modules", "method", "world", "repair", "seed"],
  ...["threshold", "inside_out", "thickness"],
]);
/** Kinds of inputs whose number of modules can be chosen. */
const SCALABLE = ["mesh", "picture"];

/** Meaning of the coloured cells of a shape without a path. @type {Record<string, string>} */
const ODD = {
  parity: "cells of the more common colour in a chessboard pattern",
  disconnected: "cells not connected to the largest part",
  "uneven-part": "cells that connect a part to the rest",
  "dead-ends": "cells with a single neighbour",
  overhang: "cells with nothing below them",
  parts: "a layer in several parts",
};
/** @type {Record<string, string>} */
const KNOTS = { unknot: "No", knotted: "Yes", undecided: "Unknown" };

export class Preview {
  /**
   * @param {PreviewFacts} facts
   * @param {Choices} choices
   * @param {URLSearchParams} query of the page's address, which stores the options
   */
  constructor(
    {
      id,
      origin,
      options: earlier,
      most_modules: maxModules,
      table_modules: maxTableModules,
      path_modules: pathModules,
    },
    choices,
    query,
  ) {
    this.id = id;
    // Fold or gallery shape that is previewed, until the preview has its own id.
    this.origin = origin;
    this.maxModules = maxModules;
    this.maxTableModules = maxTableModules;
    this.pathModules = pathModules;
    this.choices = choices;
    const choiceOf = (/** @type {ChoiceName} */ name) =>
      choices[name].find((value) => value === query.get(name)) ?? choices[name][0];
    const start = query.get("start") ?? "";
    this.bound = ""; // message for a number of modules outside the bounds
    this.givenAsVoxels = query.get("as_voxels") === "true";
    /** @type {PreviewOptions} */
    this.options = {
      module: choiceOf("module"),
      modules: this.bounded(Number(query.get("modules")) || null),
      method: choiceOf("method"),
      ends: choiceOf("ends"),
      repair: query.get("repair") === "true",
      threshold: Number(query.get("threshold")) || null,
      inside_out: query.get("inside_out") === "true",
      thickness: Number(query.get("thickness")) || null,
      as_voxels: this.givenAsVoxels,
      start: /^-?\d+,-?\d+,-?\d+$/.test(start) ? start : null,
      world: choiceOf("world"),
      seed: Number(query.get("seed")) || 0,
    };
    this.preset = earlier.preset ?? query.get("preset") ?? "default";
    this.prefer = earlier.prefer ?? "computing";
    /** @type {Api.Preview | null} */
    this.report = null;
    /** @type {{ module: number, cell: number[] | null } | null} */
    this.picked = null;
    /** @type {Api.TableOffer[]} versions of the shape that are known to fold on a table */
    this.offers = [];
    this.restrict();
  }

  get onTable() {
    return this.options.world === "table";
  }

  // Return whether a chain of the chosen modules can follow each path through cells.
  get followsPaths() {
    return this.pathModules.includes(this.options.module);
  }

  // Return whether a chain may fold on a table; that of a file may have other modules.
  get mayRest() {
    return this.report?.kind !== "chain" || this.report.follows_paths;
  }

  /** @returns {Form} */
  get fields() {
    return { ...(this.id ? { preview: this.id } : this.origin), ...this.options };
  }

  // Address of the page under its site, with the options that differ from the defaults.
  get path() {
    return `/previews/${this.id}${this.query}`;
  }

  // Options that differ from the defaults of the page, as the query of its address.
  get query() {
    const usual = Object.values(this.choices).map(([first]) => first);
    const query = new URLSearchParams();
    for (const [key, value] of Object.entries(this.options))
      if (value && !usual.includes(String(value))) query.set(key, String(value));
    if (this.preset !== "default") query.set("preset", this.preset);
    return query.size ? `?${query}` : "";
  }

  // Clamp a number of modules to the bounds; set `bound` to a message if it was outside.
  /** @param {number | null} modules */
  bounded(modules) {
    this.bound = "";
    if (modules === null) return null;
    const count = Math.min(
      this.maxModules,
      Math.max(MIN_MODULES, Math.round(modules) || MIN_MODULES),
    );
    if (count === this.maxModules) this.bound = `At most ${integerText(count)} modules`;
    else if (modules < MIN_MODULES) this.bound = `At least ${MIN_MODULES} modules`;
    return count;
  }

  /** @param {number} place of the slider */
  modulesAt(place) {
    return Math.round(MIN_MODULES * (this.maxModules / MIN_MODULES) ** (place / SLIDER_STEPS));
  }

  /** @param {number} modules */
  placeOf(modules) {
    return Math.round(
      (SLIDER_STEPS * Math.log(modules / MIN_MODULES)) / Math.log(this.maxModules / MIN_MODULES),
    );
  }

  // Change options. Repairs and blocks are reset when the environment changes.
  /** @param {Partial<PreviewOptions>} change */
  change(change) {
    const afresh = "world" in change ? { repair: false, method: this.choices.method[0] } : {};
    const start = Object.keys(change).some((key) => RESHAPING.has(key)) ? { start: null } : {};
    Object.assign(
      this.options,
      afresh,
      start,
      change,
      "modules" in change && { modules: this.bounded(change.modules ?? null) },
    );
    this.restrict();
  }

  // Set preset and preference; only the default preset has several plans to choose from.
  /**
   * @param {string} preset
   * @param {string} prefer
   */
  plan(preset, prefer) {
    Object.assign(this, { preset, prefer });
    this.restrict();
  }

  // Reset options that are not available, for example on a table.
  restrict() {
    const { options, choices } = this;
    if (this.onTable) {
      Object.assign(options, { start: null, ends: choices.ends[0], module: choices.module[0] });
      if (options.method !== "blocks") options.method = choices.method[0];
      this.preset = "default";
    }
    if (!this.choosing) this.prefer = "computing";
  }

  get choosing() {
    return this.settable === "robot";
  }

  // Return the settings that can be changed: of the table, the published method, or the robots.
  get settable() {
    if (this.onTable) return "table";
    return { paper: /** @type {const} */ ("paper"), default: /** @type {const} */ ("robot") }[
      this.preset
    ];
  }

  /** @param {Api.Preview} report */
  take(report) {
    this.id = report.id;
    this.picked = null;
    this.offers = [];
    this.report = report;
    if (report.not_started) this.options.start = null; // the report has another path
    if (this.isScalable && this.options.modules === null) this.bounded(report.modules);
  }

  // Handle options without a preview: keep the previous report, but without a path to fold.
  refuse() {
    this.options.start = null;
    if (this.report) this.report = { ...this.report, has_path: false };
  }

  // Remedies for a path that cannot be folded on a table:
  // another path through its cells, or zero gravity.
  /** @returns {Offer[]} */
  get waysFromPath() {
    return [
      { text: "Find another path through these cells", primary: true, change: { as_voxels: true } },
      this.floating,
    ];
  }

  /** @returns {Offer} */
  get floating() {
    return {
      text: "Fold in zero gravity",
      change: { as_voxels: this.givenAsVoxels, world: "floating" },
    };
  }

  // Number of modules in the field and on the slider; null if it cannot be chosen.
  get count() {
    return this.options.modules ?? (this.isScalable ? (this.report?.modules ?? null) : null);
  }

  get isScalable() {
    return SCALABLE.includes(this.report?.kind ?? "");
  }

  get expected() {
    const { report, preset, prefer } = this;
    if (!report?.has_path) return "–";
    const usual = prefer === "computing" ? report.expected_s : report.expected_preferred_s;
    return duration(preset === "paper" ? report.expected_as_published_s : usual);
  }

  // Warning before a long chain is folded on a table.
  get warning() {
    return this.onTable && this.report && this.report.modules > this.maxTableModules
      ? `Chains of more than ${integerText(this.maxTableModules)} modules usually get stuck on a ` +
          `table.`
      : "";
  }

  // The clicked module or the chosen start cell, with the action of its button.
  get start() {
    const {
      options: { start },
      report,
    } = this;
    // The final path may lack the cell.
    const picked = report?.has_path && report.final !== false ? this.picked : null;
    const first = picked?.module === 0;
    if (this.onTable || (!picked && !start)) return null;
    if (!report || !picked || (first && start))
      return {
        text: `The chain starts at cell (${start?.replaceAll(",", ", ")})`,
        button: first ? "" : "Undo",
        change: { start: null },
      };
    const text =
      `Module ${integerText(picked.module + 1)} of ` +
      `${integerText(report.modules)}${first ? ", the first" : ""}`;
    return { text, button: "Start here", change: { start: picked.cell?.join(",") ?? null } };
  }
}

// Texts of the page about a report.

// What is missing of the file and what is outside of it; empty without a likeness.
/** @param {Api.Preview["likeness"]} likeness */
export function likenessWords(likeness) {
  if (!likeness) return "";
  const { missing, added } = likeness;
  const parts = [
    missing ? `${percent(missing)} of your file is missing` : "",
    added ? `${percent(added)} of the modules’ volume is outside of it` : "",
  ]
    .filter(Boolean)
    .join(", ");
  return parts && `${sentence(parts)}.`;
}

/** @param {Api.Preview} report */
export function verdictOf({ module_words: words, modules, iou, has_path: path, final = true }) {
  if (!path) return `${integerText(modules)} cells, no path yet`;
  const likeness = iou === null ? "" : ` · ${percent(iou)} like your file`;
  return `${countedText(modules, words)}${likeness}${final ? "" : ", improving…"}`;
}

// Return possible numbers of modules nearby, and a text that explains them.
/**
 * @param {Preview} preview
 * @param {Api.Preview} report
 */
export function nearby(
  { bound, onTable, maxModules },
  { asked: requested, modules, below, above },
) {
  const nearest =
    (requested ?? modules) === modules
      ? ""
      : `${integerText(modules)} is the closest possible number to ` +
        `${integerText(requested ?? modules)}`;
  // On a table, a neighbouring count may have no path; the checked versions are offered instead.
  const counts = onTable
    ? []
    : [below, above].flatMap((n) => (n && n !== modules && n <= maxModules ? [n] : []));
  return {
    counts,
    text: [bound, nearest].filter(Boolean).join("; ") || (counts.length ? "Also possible" : ""),
  };
}

/** @param {Api.Preview} report */
export function figuresOf({ iou, likeness, candidates, knot }) {
  const { verdict = "", determinant = null } = knot ?? {};
  const knotted = verdict === "knotted";
  return {
    iou: iou === null ? "" : percent(iou),
    likeness: likenessWords(likeness ?? null),
    candidates: String(candidates),
    knotted,
    knotHint: determinant
      ? `${knotted ? "The knot is undone while the chain unfolds, which takes longer. " : ""}The ` +
        `chain’s determinant, a test number for knots, is ${determinant}. Without a knot, it ` +
        `would be 1.`
      : "",
    knot: knot ? KNOTS[verdict] : "–",
  };
}

// Return the reasons why the shape cannot be folded, and remedies.
/**
 * @param {Preview} preview
 * @param {Api.Preview} report
 */
export function troubleOf(
  { onTable, followsPaths, options: { method }, floating },
  { modules, feasibility },
) {
  const details = feasibility?.problems.map(({ detail }) => detail) ?? [];
  if (onTable)
    return {
      title: `With ${integerText(modules)} modules, this shape can’t be folded on a table`,
      details,
      ways: [floating],
    };
  /** @type {Offer[]} */
  const ways = (feasibility?.repairs ?? [])
    .filter(({ add, drop }) => add.length || drop.length)
    .slice(0, 1)
    .map(({ detail, doubled, modules: needed }) => ({
      text: `Repair: ${detail.charAt(0).toLowerCase()}${detail.slice(1, -1)}`,
      primary: true,
      change: { repair: true, ...(doubled && { modules: needed }) },
    }));
  // Their blocks would be disconnected, too.
  const apart = feasibility?.problems.some(({ code }) => code === "disconnected");
  if (method !== "blocks" && followsPaths && !apart)
    ways.push({ text: "Use 2×2×2 modules for each cell", change: { method: "blocks" } });
  return {
    title:
      feasibility?.feasible === false
        ? "No path runs through all of these cells"
        : "No path was found",
    details,
    ways,
  };
}

// Return the meaning of the coloured cells; empty if there are none.
/** @param {Api.Preview} report */
export function oddWords({ has_path: path, feasibility }) {
  const marked = path ? undefined : feasibility?.problems.find(({ cells }) => cells.length);
  return marked ? (ODD[marked.code] ?? "cells that prevent a path") : "";
}

// Return whether the cells leave out a part of the file.
/** @param {Api.Preview} report */
export function isLossy({ unused_bodies: unused = [], keeps_parts: keeps = null }) {
  return unused.length > 0 || keeps === false;
}

// Return about how many modules it takes to be how much like the file, and what helps if no number
// is enough for more.
/**
 * @param {Preview} preview
 * @param {Api.Preview} report
 */
export function reachOf({ maxModules }, { reach = [] }) {
  const ways = reach.flatMap(({ likeness, modules }) =>
    modules === null
      ? []
      : [
          {
            text: `${percent(likeness)}: ${integerText(modules)}`,
            change: { modules },
            label: `About ${integerText(modules)} modules are ${percent(likeness)} like your file`,
          },
        ],
  );
  const beyond = reach.find(({ modules }) => modules === null);
  const limit = beyond
    ? `Even ${integerText(maxModules)} modules are less than ${percent(beyond.likeness)} like ` +
      `your file. Thicker parts would help more.`
    : "";
  return { ways, limit };
}

// Return the notes on the cells: their repair, their missing order, and all others.
/**
 * @param {Preview} preview
 * @param {Api.Preview} report
 */
export function notesOf(
  { onTable, options },
  { notes, repaired: repair = "", has_path: path, as_voxels: asVoxels },
) {
  const unordered = asVoxels && !options.as_voxels ? notes[0] : "";
  const doubled = path && onTable && options.method === "blocks";
  const repaired = options.repair && repair ? `Repaired: ${repair}` : "";
  return {
    repaired: doubled ? "Each cell became 2×2×2 modules." : repaired,
    unordered,
    others: notes.filter((note) => note !== unordered).map(sentence),
  };
}

// Return the button of a version of the shape that folds on a table.
/**
 * @param {Api.TableOffer} offer
 * @param {number} place in the list
 * @returns {Offer}
 */
export function offerOf({ kind, modules, change, added }, place) {
  const words = {
    repair:
      `Add ` +
      `${added.length} cell${added.length === 1 ? "" : "s"}: ${integerText(modules)} modules`,
    modules: `Use ${integerText(modules)} modules, one for each cell`,
    blocks: `Use ${integerText(modules)} modules, 2×2×2 for each cell`,
  };
  const settings = Object.fromEntries(Object.entries(change).filter(([, value]) => value !== null));
  return { text: words[kind], primary: place === 0, change: settings };
}
