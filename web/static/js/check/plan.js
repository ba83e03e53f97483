// Reading of a plan file, with checks of its consistency.
import { dot, FREE, isKnown, KNOWN, Module, TWISTS } from "./module.js";
import { Archive, quoted, readable, TYPES, Unreadable } from "./npz.js";

/** @typedef {import("./module.js").Geometry} Geometry */
/** @typedef {import("./module.js").Vector} Vector */
/**
 * @typedef {{ modules: [number, number], frame: number, gap: number, fits: number }} Place gap, in
 *   widths of a module's cell, and largest size of modules that still fit
 */
/**
 * @typedef {{ verdict: string, limits: string, standard: boolean, module: string, exempt: number,
 *   start: string, end: string }} Said what was proved, and of what, but for how many pairs; the
 *   words are those of foldback_check.py
 */

const FORMATS = ["foldback-claim/1", "foldback-claim/2"]; // first: one part and equal ranges
const RULES = ["", "none", "consecutive modules (i, i+1)"]; // of exempt pairs, by `apart`
const SLIP = 1e-6; // rad by which a hinge may miss what is said of it; by more, it is bent
const STEP = (Math.PI / 2) * 2 ** -23; // rad, unit of angles in planes
const MAX_MODULES = 2 ** 18,
  MAX_FRAMES = 2 ** 20,
  MAX_PIECES = 16, // also of parts of a piece
  MAX_CORNERS = 96, // also of faces and edges of a part
  MAX_HINGES = 4,
  MAX_LETTERS = 16,
  MAX_DEPTH = 64;

/** A claim that could not be proved, and its place. */
export class NotProved extends Error {
  verdict = "not proved";

  /**
   * @param {string} message
   * @param {Place | null} [place]
   */
  constructor(message, place = null) {
    super(message);
    this.place = place;
  }
}

/**
 * @param {unknown} condition
 * @param {string} message
 * @returns {asserts condition}
 */
function require(condition, message) {
  if (!condition) throw new NotProved(message);
}

/** @type {(value: unknown) => Record<string, any>} a JSON object */
function fields(value) {
  if (typeof value !== "object" || !value || Array.isArray(value))
    throw new Unreadable(`got ${quoted(value)}, expected a JSON object`);
  return value;
}

/**
 * Return a finite number, or nested lists of them; −n stands for a length from 1 to n.
 * @param {unknown} value
 * @param {number[]} lengths
 * @returns {any}
 */
function numbers(value, ...lengths) {
  const [length, ...innerLengths] = lengths;
  if (length === undefined) {
    if (!Number.isFinite(value)) throw new Unreadable(`got ${quoted(value)}, expected a number`);
    return value;
  }
  if (
    !Array.isArray(value) ||
    (value.length !== length && !(value.length > 0 && value.length <= -length))
  ) {
    throw new Unreadable(
      `got ${quoted(value)}, expected a list of ` +
        `${Math.abs(length)} parts${length < 0 ? " at most" : ""}`,
    );
  }
  return value.map((part) => numbers(part, ...innerLengths));
}

/** @type {(value: unknown, min: number, max: number) => number} a whole number of a range */
function wholeNumber(value, min, max) {
  const number = numbers(value);
  readable(
    Number.isInteger(number) && number >= min && number <= max,
    `got ${quoted(value)}, expected a whole number from ${min} to ${max}`,
  );
  return number;
}

/** Return a JSON text's object, in which no name occurs twice. @param {string} text */
function parsed(text) {
  const root = JSON.parse(text),
    parts = text.replace(/\\./gs, "").split('"'); // outside of strings, inside, outside, ...
  let names = parts.filter((part, k) => k % 2 === 0 && /^\s*:/.test(part)).length,
    depth = 0;
  for (
    let level = [root];
    level.length;
    level = level.flatMap((value) =>
      value && typeof value === "object" ? Object.values(value) : [],
    )
  ) {
    readable(++depth <= MAX_DEPTH, "the text of the plan is nested too deeply");
    for (const value of level)
      if (value && typeof value === "object" && !Array.isArray(value))
        names -= Object.keys(value).length;
  }
  readable(names === 0, "a name occurs twice in the text of the plan");
  return fields(root);
}

/** @type {(value: unknown, most: number) => any[]} a list of 1 to `most` values */
function listed(value, most) {
  readable(
    Array.isArray(value) && value.length > 0 && value.length <= most,
    `got ${quoted(value)}, expected a list of ${most} parts at most`,
  );
  return /** @type {any[]} */ (value);
}

/**
 * @type {(description: Record<string, any>, plain: boolean) => Geometry} a description of modules,
 *   a plain one of one part and equal ranges; lists and texts have a bounded length
 */
function geometry(description, plain) {
  const { hinges, limit_rad: limit } = description;
  readable(
    Array.isArray(hinges) &&
      hinges.length > 0 &&
      hinges.length <= MAX_HINGES &&
      hinges.every((name) => typeof name === "string" && name.length <= MAX_LETTERS),
    "names of hinges that cannot be",
  );
  const { pieces, links, pattern } = plain
    ? {
        pieces: [[description]],
        links: [
          {
            ...description,
            ranges_rad: hinges.map(() => [-(/** @type {number} */ (numbers(limit))), limit]),
          },
        ],
        pattern: [[0, 0]],
      }
    : description;
  const bodies = listed(pieces, MAX_PIECES).map((parts) =>
      listed(parts, MAX_PIECES).map((part) => ({
        corners: numbers(fields(part).corners, -MAX_CORNERS, 3),
        faces: numbers(part.faces, -MAX_CORNERS, 3),
        edges: numbers(part.edges, -MAX_CORNERS, 3),
      })),
    ),
    count = listed(links, MAX_MODULES).length;
  for (const { corners, faces } of plain ? [] : bodies.flat())
    for (const face of faces) {
      const high = corners.map((/** @type {Vector} */ v) => dot(v, face)),
        ends = [Math.max(...high), Math.min(...high)];
      require(ends.some(
        (end) => high.filter((/** @type {number} */ x) => Math.abs(x - end) < 1e-9).length > 2,
      ), "a part with corners outside its faces");
    }
  return {
    pieces: bodies,
    links: links.map((/** @type {unknown} */ link) => {
      const { anchor, offset, turns, ranges_rad: ranges } = fields(link);
      return {
        anchor: numbers(anchor, 3),
        offset: numbers(offset, 3),
        turns: numbers(turns, hinges.length + 1, 3, 3),
        ranges_rad: numbers(
          listed(ranges, MAX_HINGES).map((range) => range ?? [-FREE, FREE]),
          hinges.length,
          2,
        ),
      };
    }),
    pattern: numbers(pattern, -MAX_MODULES, 2).map((/** @type {number[]} */ [piece, link]) => [
      wholeNumber(piece, 0, bodies.length - 1),
      wholeNumber(link, 0, count - 1),
    ]),
    hinges,
    rigid_links: wholeNumber(description.rigid_links, 0, 1),
    apart: wholeNumber(description.apart, 1, 2),
  };
}

/**
 * @type {(values: Float64Array) => number} largest absolute value; Infinity if one is not a number
 */
const widest = (values) =>
  values.reduce((largest, x) => Math.max(largest, Number.isNaN(x) ? Infinity : Math.abs(x)), 0);
/** @type {(a: ArrayLike<number>, b: ArrayLike<number>) => boolean} */
const near = (a, b) =>
  a.length === b.length && Array.prototype.every.call(a, (x, k) => Math.abs(x - b[k]) <= SLIP);
/** @type {(values: Float64Array) => boolean} */
const rise = (values) => values.every((x, k) => Number.isFinite(x) && (!k || x >= values[k - 1]));
/** @type {(x: number) => number} the nearest whole number, of two the even one */
const nearest = (x) => (x - Math.floor(x) === 0.5 ? 2 * Math.round(x / 2) : Math.round(x));
/** @type {(values: Float64Array) => Int32Array} how many of the values before each are bent */
const bends = (values) => {
  const counts = new Int32Array(values.length + 1);
  values.forEach((x, k) => {
    counts[k + 1] = counts[k] + Number(Math.abs(x) > SLIP);
  });
  return counts;
};

export class Plan {
  /** @type {Float64Array} */
  times = new Float64Array();
  /**
   * In frame k, the angles of hinges first[k] to last[k] − 1 start at
   * values[offsets[k]]; earlier hinges are folded, later ones at 0.
   * @type {Float64Array}
   */
  first = new Float64Array();
  last = this.first;
  offsets = this.first;
  values = this.first;
  windowed = false;
  frames = 0;
  maxAngle = 0;

  /** Open a plan; `facts` are not checked. @param {Uint8Array<ArrayBuffer>} bytes */
  static async open(bytes) {
    const file = new Archive(bytes),
      plan = new Plan(parsed((await file.texts("plan"))[0]));
    await plan.load(file);
    return plan;
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  static async read(bytes) {
    try {
      const plan = await Plan.open(bytes),
        wrong = Object.entries(await plan.facts()).find(([, holds]) => !holds);
      require(!wrong, String(wrong?.[0]));
      return plan;
    } catch (error) {
      const reason =
        error instanceof NotProved || error instanceof Unreadable
          ? error.message
          : quoted(String(error));
      const refusal = new NotProved(
        `The plan cannot be read, or it contradicts itself: ${reason}.`,
      );
      if (!(error instanceof NotProved)) refusal.verdict = "no plan";
      throw refusal;
    }
  }

  /** @param {Record<string, any>} description the plan's own description */
  constructor(description) {
    const certificate = (this.certificate = fields(description.certificate));
    require(certificate.verified ===
      true, `the plan says that it is not verified: ${quoted(certificate.verdict)}`);
    const chain = fields(description.chain),
      claim = (this.stated = fields(description.claim));
    require(FORMATS.includes(claim.format), `its claim has the format ${quoted(claim.format)}, ` +
      `expected ${FORMATS.join(" or ")}; another version of this checker may know it`);
    const plain = claim.format === FORMATS[0];
    this.coded = description.angles;
    this.rest = plain ? "straight" : "at rest (all hinges at 0)";
    this.kind = chain.module?.name ?? chain.module;
    this.n = wholeNumber(chain.modules, 2, MAX_MODULES);
    readable(typeof this.kind === "string", `got ${quoted(this.kind)}, expected a kind of module`);
    this.standard = [KNOWN, TWISTS].some((known) => Object.hasOwn(known, this.kind));
    const described = geometry(fields(claim.module), plain);
    this.size = numbers(certificate.module_size);
    this.claim = numbers(certificate.clearance_bound ?? 0);
    this.step = (numbers(certificate.max_joint_step_rad ?? 0) || Infinity) + 1e-9;
    this.module = new Module(described, this.size);
    require(this.module.sound, "a module that cannot be");
    require(!this.standard ||
      isKnown(this.kind, described, (values) =>
        geometry(values, true),
      ), `modules with the name ${this.kind}, but of another kind`);
    this.pad = described.rigid_links * this.module.hinges;
    const hinges = (this.n - 1) * this.module.hinges - this.pad;
    this.folded = Float64Array.from(numbers(chain.folded_rad, hinges));
    this.start =
      description.start == null
        ? new Float64Array(hinges)
        : Float64Array.from(numbers(fields(description.start).folded_rad, hinges));
  }

  /** Read names, times and angles of a file, sizes first. @param {Archive} file */
  async load(file) {
    const {
        n,
        module: {
          geometry: { hinges, rigid_links: rigid },
        },
      } = this,
      J = this.folded.length,
      windowed = (this.windowed = file.has("first"));
    const [frames] = await file.shape(windowed ? "first" : "time_s", 1),
      plain = windowed ? "angles_rad" : "joint_angles_rad";
    readable(
      frames > 0 && frames <= MAX_FRAMES,
      `got ${frames} frames, expected 1 to ${MAX_FRAMES}`,
    );
    this.frames = frames;
    const stored = Object.keys(TYPES).filter((name) => name.includes("angle") && file.has(name)),
      planes = stored[0] === "angle_planes";
    readable(
      stored.length === 1 && (planes || stored[0] === plain),
      "the angles are missing, or stored more than once",
    );
    const shape = await file.shape(stored[0], planes || !windowed ? 2 : 1),
      count = planes ? shape[1] : shape.reduce((a, b) => a * b, 1);
    readable(
      windowed ? count <= frames * J : count === frames * J,
      "the number of angles does not match the hinges and frames",
    );
    const names = Array.from({ length: n - 1 - rigid }, (_, i) =>
      hinges.map((h) => `joint_${i + rigid}${h}`),
    ).flat();
    require(JSON.stringify(names) ===
      JSON.stringify(
        await file.texts("joint_names", J),
      ), "the names of the hinges do not match the chain");
    this.times = await file.numbers("time_s", frames);
    this.first = windowed ? await file.numbers("first", frames) : new Float64Array(frames);
    this.offsets = windowed
      ? await file.numbers("offsets", frames + 1)
      : Float64Array.from({ length: frames + 1 }, (_, k) => k * J);
    this.last = this.first.map((a, k) => a + this.offsets[k + 1] - this.offsets[k]);
    require(this.offsets[0] === 0 &&
      this.offsets[frames] === count &&
      rise(this.offsets) &&
      this.first.every(
        (a, k) => a >= 0 && this.last[k] <= J,
      ), "the windows do not match the chain");
    this.values = planes
      ? this.decoded(await file.numbers("angle_planes", 4, count), count)
      : await file.numbers(plain, ...(windowed ? [count] : [frames, J]));
    this.maxAngle = Math.max(widest(this.values), widest(this.folded));
  }

  /**
   * Return angles in planes: third differences of frames, or changes in windows.
   * @param {Float64Array} planes
   * @param {number} count
   */
  decoded(planes, count) {
    const { folded, frames, windowed, first, last, offsets } = this,
      J = folded.length,
      coded = fields(this.coded);
    readable(
      coded.encoding === "zigzag-planes" &&
        coded.step_rad === STEP &&
        coded.differences === (windowed ? "window" : 3) &&
        `${numbers(coded.shape, -2)}` === `${windowed ? [count] : [frames, J]}`,
      "angles in planes of another kind",
    );
    const values = Float64Array.from({ length: count }, (_, k) => {
      // integers with the sign in the lowest bit
      const code =
        planes[k] +
        256 * (planes[count + k] + 256 * (planes[2 * count + k] + 256 * planes[3 * count + k]));
      return code % 2 ? -(code + 1) / 2 : code / 2;
    });
    if (!windowed) {
      for (let d = 0; d < 3; d++) {
        for (let k = J; k < count; k++) values[k] += values[k - J];
        readable(widest(values) < 2 ** 40, "angles in planes are too large");
      }
      return values.map((x) => x * STEP);
    }
    const now = new Float64Array(J),
      foldedSteps = folded.map((x) => nearest(x / STEP));
    first.forEach((a, k) => {
      for (let h = a, at = offsets[k]; h < last[k]; h++, at++)
        values[at] = Math.fround((now[h] += values[at]) * STEP);
      // Value on entering the window.
      for (let h = 0; h < J; h++) if (h < a || h >= last[k]) now[h] = h < a ? foldedSteps[h] : 0;
    });
    return values;
  }

  /** Return the possible defects of a plan, each with true if the plan is free of it. */
  async facts() {
    const {
      certificate,
      n,
      size,
      claim,
      frames,
      pad,
      folded,
      times,
      module: {
        geometry: { apart },
      },
    } = this;
    const exempt = certificate.exempt_pairs == null ? null : fields(certificate.exempt_pairs),
      digest = this.stated.angles_sha256;
    return {
      "a hinge turns beyond its range": this.within(),
      "the module size or the clearance is out of range": size > 0 && size <= 1 && claim > 0,
      "the certificate does not cover the same pairs of modules as this check":
        !exempt ||
        (numbers(exempt.apart) === apart &&
          numbers(exempt.count) === (apart - 1) * (n - 1) &&
          [RULES[apart], null, undefined].includes(exempt.rule)),
      "the number of frames differs from the certificate":
        certificate.frames == null || numbers(certificate.frames) === frames,
      "the times do not increase": rise(times),
      "the first frame is not the start shape": near(this.frame(0).subarray(pad), this.start),
      "the last frame is not the folded shape": near(this.frame(frames - 1).subarray(pad), folded),
      // Browsers provide hashes only on https and localhost; the proof itself needs no digest.
      "the checksum of the angles does not match":
        digest == null || !globalThis.crypto?.subtle || digest === (await this.digest()),
    };
  }

  /** Return true if all angles are in the ranges of their hinges. */
  within() {
    const { module, folded, values, first, last, offsets, pad } = this,
      ranges = Array.from(folded, (_, h) => {
        const slot = pad + h;
        return module.link(Math.floor(slot / module.hinges)).ranges_rad[slot % module.hinges];
      }),
      holds = (/** @type {number} */ x, /** @type {number} */ h) =>
        x >= ranges[h][0] - SLIP && x <= ranges[h][1] + SLIP;
    return (
      folded.every(holds) &&
      first.every((a, k) =>
        values.subarray(offsets[k], offsets[k] + last[k] - a).every((x, h) => holds(x, a + h)),
      )
    );
  }

  /**
   * Say what a proof of the motion is about.
   * @param {number} step largest turn of a hinge between two frames
   * @returns {Said}
   */
  words(step) {
    const {
        values,
        folded,
        first,
        offsets,
        frames,
        standard,
        kind,
        rest,
        n,
        module: {
          radius,
          geometry: { apart },
        },
      } = this,
      within = bends(values),
      before = bends(folded);
    const bent = Array.from(
        { length: frames },
        (_, k) => within[offsets[k + 1]] - within[offsets[k]] + before[first[k]],
      ),
      straight = bent.indexOf(0);
    const shape = (/** @type {number} */ k) =>
      `${bent[k]} of ${folded.length} hinges are bent, by up to ` +
      `${(widest(this.frame(k)) * (180 / Math.PI)).toFixed(1)} degrees`;
    const limits = [
      step === 0 || !bent[frames - 1] ? "nothing folds" : "",
      standard ? "" : "only for modules as the plan describes them, not foldback's",
      straight < 0 ? "only from another shape, without being straight" : "",
    ]
      .filter(Boolean)
      .join(" and ");
    return {
      verdict: limits ? `proved, but ${limits}` : "proved",
      limits,
      standard,
      module: standard
        ? kind
        : `${quoted(kind)} as the plan describes it, not one of foldback's: its corners are up ` +
          `to ${(100 * radius).toFixed(1)} % of the spacing from its centre`,
      exempt: (apart - 1) * (n - 1),
      start: bent[0]
        ? `in another shape: ${shape(0)}; the chain is ` +
          `${straight < 0 ? `never ${rest}` : `${rest} after ${straight} of ${frames - 1} steps`}`
        : rest,
      end: bent[frames - 1] ? `folded: ${shape(frames - 1)}` : rest,
    };
  }

  /**
   * Return the SHA-256 of the angles as 64-bit floats; for windows, of
   * first and offsets as 64-bit integers, then the angles as 32-bit floats.
   */
  async digest() {
    const { windowed, first, offsets, values } = this;
    const parts = windowed
      ? [BigInt64Array.from([...first, ...offsets], BigInt), Float32Array.from(values)]
      : [Float64Array.from(values)];
    const hash = new Uint8Array(
      await crypto.subtle.digest("SHA-256", await new Blob(parts).arrayBuffer()),
    );
    return Array.from(hash, (byte) => byte.toString(16).padStart(2, "0")).join("");
  }

  /** Return the angles of a frame, including those of rigid links. @param {number} k */
  frame(k) {
    const {
        pad,
        folded,
        values,
        first: { [k]: a },
        last: { [k]: b },
        offsets: { [k]: offset },
      } = this,
      angles = new Float64Array(pad + folded.length);
    angles.set(folded.subarray(0, a), pad);
    angles.set(values.subarray(offset, offset + b - a), pad + a);
    return angles;
  }
}
