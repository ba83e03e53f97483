// Modules of one's own: a module file and a chain file become one chain file.

const MODULE = "foldback-module/1";
const CHAIN = "foldback-chain/1";
/** Size of a file in bytes up to which it may be a module or its chain. */
const MAX_BYTES = 4_000_000;
/** Number of joints of the straight chain that shows a module. */
const SHOWN_JOINTS = 7;

/** @typedef {Record<string, unknown>} Values */

// Return the object in a JSON file of one of the two formats; null for every other file.
/**
 * @param {File} file
 * @returns {Promise<Values | null>}
 */
async function valuesOf(file) {
  if (file.size > MAX_BYTES) return null;
  const text = await file.text();
  if (!/^\s*\{/u.test(text) || !text.includes("foldback-")) return null;
  try {
    /** @type {Values} */
    const values = JSON.parse(text);
    return values.format === MODULE || values.format === CHAIN ? values : null;
  } catch {
    return null; // the server says what is wrong
  }
}

/**
 * @param {Values} module
 * @param {Values} chain
 * @param {string} name
 */
function chainFile(module, chain, name) {
  const pitch = typeof module.pitch_m === "number" ? { pitch_m: module.pitch_m } : {};
  const text = JSON.stringify({ ...pitch, ...chain, format: CHAIN, module });
  return new File([text], name, { type: "application/json" });
}

export class OwnModule {
  /** @type {Values | null} */
  #module = null;

  // Return the file to send: a chain file gets the module of the other file, or of an earlier one.
  /**
   * @param {File[]} files
   * @returns {Promise<File | null>} null for files that do not belong together
   */
  async join(files) {
    if (files.length > 2) return null;
    const values = await Promise.all(files.map(valuesOf));
    const module = values.findIndex((one) => one?.format === MODULE);
    const chain = values.findIndex((one) => one?.format === CHAIN);
    if (files.length === 2 && (module < 0 || chain < 0)) return null;
    if (module >= 0) this.#module = values[module];
    const angles = values[chain];
    if (!angles || !this.#module || "module" in angles) return files[0];
    return chainFile(this.#module, angles, files[chain].name);
  }

  // Return a file of a straight chain of the latest module.
  /** @returns {File} */
  straight() {
    const module = this.#module ?? {};
    const [piece] = /** @type {any[]} */ (module.pieces);
    const row = piece.joint.hinges.length === 1 ? 0 : piece.joint.hinges.map(() => 0);
    const name = String(module.name);
    const angles = Array(SHOWN_JOINTS).fill(row);
    return chainFile(module, { name, joint_angles_deg: angles }, `${name}.json`);
  }
}
