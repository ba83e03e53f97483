// Reads a file of NumPy arrays: a zip archive whose entries are .npy files.

/** @typedef {{ shape: number[], values: Float64Array | string[] }} Column values in C order */
/** @typedef {{ kind: string, width: number }} Dtype */

/** The file holds no plan. */
export class Unreadable extends Error {}

/**
 * @param {unknown} condition
 * @param {string} message
 * @returns {asserts condition}
 */
export function readable(condition, message) {
  if (!condition) throw new Unreadable(message);
}

/**
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @returns {Promise<Map<string, Column>>}
 */
export async function readNpz(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let end = bytes.length - 22;
  while (end >= 0 && view.getUint32(end, true) !== 0x06054b50) end--;
  readable(end >= 0, "no end of an archive");
  const count = view.getUint16(end + 10, true);
  /** @type {Map<string, Column>} */
  const found = new Map();
  for (let entry = 0, at = view.getUint32(end + 16, true); entry < count; entry++) {
    readable(view.getUint32(at, true) === 0x02014b50, "no entry where the archive tells one");
    const method = view.getUint16(at + 10, true);
    const packed = view.getUint32(at + 20, true);
    const size = view.getUint32(at + 24, true);
    const named = view.getUint16(at + 28, true);
    const local = view.getUint32(at + 42, true);
    const name = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + named)).replace(/\.npy$/, "");
    readable(!found.has(name), `two arrays ${name}`);
    readable(method === 0 || method === 8, `packed by method ${method}`);
    const start = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    const stored = bytes.subarray(start, start + packed);
    const plain = method ? await inflated(stored) : stored;
    readable(plain.length === size, `${plain.length} bytes of ${name}, expected ${size}`);
    found.set(name, column(plain));
    at += 46 + named + view.getUint16(at + 30, true) + view.getUint16(at + 32, true);
  }
  return found;
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
function column(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  readable(view.getUint32(0) === 0x934e554d, "no NumPy array");
  const wide = bytes[6] > 1 ? 4 : 2;
  const start = 8 + wide + (wide > 2 ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder().decode(bytes.subarray(8 + wide, start));
  const [, kind, width] = /'descr': '[<|]([fiuU])(\d+)'/.exec(header) ?? [];
  const shape = (/'shape': \(([\d, ]*)\)/.exec(header)?.[1].match(/\d+/g) ?? []).map(Number);
  readable(kind, `an array of another kind: ${header.trim()}`);
  const count = shape.reduce((a, b) => a * b, 1);
  readable(bytes.length === start + count * Number(width) * (kind === "U" ? 4 : 1), "an array of another size than it tells");
  const values = elements(view, start, count, { kind, width: Number(width) });
  const across = header.includes("'fortran_order': True") && shape.length > 1;
  readable(!across || (shape.length === 2 && values instanceof Float64Array), "a text or a block in Fortran order");
  return { shape, values: across ? transposed(/** @type {Float64Array} */ (values), shape) : values };
}

/**
 * @param {DataView<ArrayBuffer>} view
 * @param {number} start
 * @param {number} count
 * @param {Dtype} dtype
 */
function elements(view, start, count, { kind, width }) {
  if (kind === "U") return Array.from({ length: count }, (_, k) => text(view, start + 4 * width * k, width));
  /** @type {Record<string, (at: number) => number>} */
  const readers = {
    f8: (at) => view.getFloat64(at, true), f4: (at) => view.getFloat32(at, true), u1: (at) => view.getUint8(at),
    i4: (at) => view.getInt32(at, true), i8: (at) => Number(view.getBigInt64(at, true)),
  };
  const read = readers[kind + width];
  readable(read, `numbers of the kind ${kind}${width}`);
  const values = new Float64Array(count);
  for (let k = 0; k < count; k++) values[k] = read(start + k * width);
  return values;
}

/**
 * @param {DataView<ArrayBuffer>} view
 * @param {number} start
 * @param {number} width
 */
function text(view, start, width) {
  let found = "";
  for (let k = 0; k < width; k++) {
    const code = view.getUint32(start + 4 * k, true);
    if (code) found += String.fromCodePoint(code);
  }
  return found;
}

/**
 * @param {Float64Array} values
 * @param {number[]} shape
 */
function transposed(values, [rows, columns]) {
  const found = new Float64Array(values.length);
  for (let c = 0, from = 0; c < columns; c++) for (let r = 0; r < rows; r++) found[r * columns + c] = values[from++];
  return found;
}
