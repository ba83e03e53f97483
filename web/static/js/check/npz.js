// Reads a file of NumPy arrays: a zip archive whose entries are .npy files.

/** @typedef {{ shape: number[], values: Float64Array | string[] }} Column values in C order */

const ENTRY = 0x02014b50, END = 0x06054b50, NUMPY = 0x934e554d, DEFLATED = 8;
/** @type {Record<string, new (buffer: ArrayBuffer) => Iterable<number | bigint> & { length: number }>} typed arrays by NumPy type; little-endian, as in all browsers */
const KINDS = { f8: Float64Array, f4: Float32Array, u1: Uint8Array, i4: Int32Array, i8: BigInt64Array, U: Uint32Array };
/** @type {(bytes: Uint8Array<ArrayBuffer>) => DataView<ArrayBuffer>} */
const viewOf = (bytes) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

/**
 * @param {unknown} condition
 * @param {string} message
 * @returns {asserts condition}
 */
export function readable(condition, message) {
  if (!condition) throw new Error(message);
}

/**
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @returns {Promise<Map<string, Column>>}
 */
export async function readNpz(bytes) {
  const view = viewOf(bytes), short = (/** @type {number} */ at) => view.getUint16(at, true), long = (/** @type {number} */ at) => view.getUint32(at, true);
  let end = bytes.length - 22;
  while (end >= 0 && long(end) !== END) end--;
  readable(end >= 0, "the end of the archive is missing");
  /** @type {Map<string, Column>} */
  const found = new Map();
  for (let entry = 0, at = long(end + 16); entry < short(end + 10); entry++, at += 46 + short(at + 28) + short(at + 30) + short(at + 32)) {
    readable(long(at) === ENTRY, "an entry of the archive is missing");
    const method = short(at + 10), local = long(at + 42), start = local + 30 + short(local + 26) + short(local + 28);
    const name = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + short(at + 28))).replace(/\.npy$/, "");
    readable(!found.has(name) && (method === 0 || method === DEFLATED), `the array ${name} ${found.has(name) ? "occurs twice" : `is compressed by the unknown method ${method}`}`);
    const stored = bytes.subarray(start, start + long(at + 20)), stream = () => new Blob([stored]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    const plain = method ? new Uint8Array(await new Response(stream()).arrayBuffer()) : stored;
    readable(plain.length === long(at + 24), `the array ${name} has ${plain.length} bytes, but the archive states ${long(at + 24)}`);
    found.set(name, column(plain));
  }
  return found;
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
function column(bytes) {
  const view = viewOf(bytes), wide = bytes[6] > 1 ? 4 : 2, start = 8 + wide + (wide > 2 ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder().decode(bytes.subarray(8 + wide, start)), [, kind, digits] = /'descr': '[<|]([fiuU])(\d+)'/.exec(header) ?? [];
  const shape = (/'shape': \(([\d, ]*)\)/.exec(header)?.[1].match(/\d+/g) ?? []).map(Number), [rows, columns] = shape;
  const Kind = KINDS[kind === "U" ? kind : kind + digits], across = header.includes("'fortran_order': True") && shape.length > 1;
  readable(view.getUint32(0) === NUMPY && Kind && (!across || (shape.length === 2 && kind !== "U")), `an array has an unsupported data type or memory order: ${header.trim()}`);
  const items = new Kind(bytes.slice(start).buffer), count = shape.reduce((a, b) => a * b, 1), width = kind === "U" ? Number(digits) : 1;
  readable(items.length === count * width, "an array does not have the size that its header states");
  if (kind === "U") {
    const letters = Array.from(items, (code) => (code ? String.fromCodePoint(Number(code)) : ""));
    return { shape, values: Array.from({ length: count }, (_, k) => letters.slice(k * width, (k + 1) * width).join("")) };
  }
  const values = Float64Array.from(items, Number);
  return { shape, values: across ? values.map((_, k) => values[(k % columns) * rows + Math.floor(k / columns)]) : values };
}
