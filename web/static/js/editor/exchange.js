// Exchange between the editor and the service: files, cells of files, and paths through cells.
import { ask, formOf, ownKey } from "../lib/api.js";
export { openFold } from "../lib/fold_request.js";
import { neighbours, through } from "./cell_path.js";
import { cellOf, cellsOf, keyOf, keysOf, parts } from "./painting.js";

/**
 * Maximum number of remaining cells for which the
 * browser itself searches the path, by backtracking.
 */
const FEW = 8;

/**
 * @param {string} name
 * @param {Painted} painted
 * @param {boolean} doubled
 */
export function voxelFile(name, { cells, size }, doubled = false) {
  const voxels = {
    format: "foldback-voxels/1",
    name,
    cells: cellsOf(keysOf(cells), size, doubled),
  };
  return new File([JSON.stringify(voxels)], "painted.json", { type: "application/json" });
}

/**
 * @param {string} name
 * @param {Painted} painted
 */
export function pathFile(name, { path, size }) {
  const written = { format: "foldback-path/1", name, cells: cellsOf(path, size) };
  return new File([JSON.stringify(written)], "path.json", { type: "application/json" });
}

// Request the report on a shape. Throws a Refusal.
/**
 * @param {Form} fields
 * @returns {Promise<Api.Preview>}
 */
export const report = (fields) =>
  ask("/api/shapes/preview", { body: formOf(fields), token: ownKey() });

// Read the cells of a file, or of a previous upload, without a search for a path.
/**
 * @param {{ file: File } | { preview: string }} source
 * @param {number} cells approximate number of cells for a mesh
 */
export async function read(source, cells) {
  const answer = await report({ ...source, method: "exact", modules: cells, path: false });
  if (!answer.follows_paths)
    throw new Error(
      `This is a chain of ${answer.module_words.plural}. Only modules that fill a cell each can ` +
        "be painted.",
    );
  return answer;
}

// Complete a path through all cells; null if no such path was found.
/**
 * @param {Painted} painted
 * @param {DrawnPath} drawn
 * @returns {Promise<DrawnPath | null>}
 */
export async function completed({ cells, size }, { path, atStart }) {
  const unvisited = cells.slice();
  for (const key of path) unvisited[key] = 0;
  const remainingKeys = keysOf(unvisited);
  if (!remainingKeys.length || parts(unvisited, size).length > 1) return null;
  const head = path.at(atStart ? 0 : -1);
  const joined = (/** @type {number[]} */ addition) => ({
    path: atStart ? [...addition.reverse(), ...path] : [...path, ...addition],
    atStart,
  });
  const starts =
    head === undefined ? [null] : neighbours(head, size).filter((key) => unvisited[key]);
  if (remainingKeys.length <= FEW) {
    for (const start of starts[0] === null ? remainingKeys : starts) {
      const addition = through(remainingKeys, Number(start), size);
      if (addition) return joined(addition);
    }
    return null;
  }
  /** @type {{ file: File } | { preview: string }} */
  let source = { file: voxelFile("The rest", { cells: unvisited, size, path: [] }) };
  for (const start of starts) {
    const wish = start === null ? null : cellOf(start, size).join(",");
    const answer = await report({ ...source, start: wish });
    source = { preview: answer.id };
    if (answer.has_path && !answer.not_started)
      return joined(answer.cells.map(([x, y, z]) => keyOf(x, y, z, size)));
  }
  return null;
}
