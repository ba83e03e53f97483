// Reads a file of NumPy arrays: a zip archive whose entries are .npy files.

/** @typedef {{ shape: number[], values: Float64Array | string[] }} Column values in C order */

const ENTRY = 0x02014b50, END = 0x06054b50, NUMPY = 0x934e554d, DEFLATED = 8;
/** @type {Record<string, ((view: DataView, at: number) => number) | undefined>} */
const READERS = {
  f8: (view, at) => view.getFloat64(at, true), f4: (view, at) => view.getFloat32(at, true), u1: (view, at) => view.getUint8(at),
  i4: (view, at) => view.getInt32(at, true), i8: (view, at) => Number(view.getBigInt64(at, true)),
};
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
  readable(end >= 0, "no end of an archive");
  /** @type {Map<string, Column>} */
  const found = new Map();
  for (let entry = 0, at = long(end + 16); entry < short(end + 10); entry++, at += 46 + short(at + 28) + short(at + 30) + short(at + 32)) {
    readable(long(at) === ENTRY, "no entry where the archive tells one");
    const method = short(at + 10), local = long(at + 42), start = local + 30 + short(local + 26) + short(local + 28);
    const name = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + short(at + 28))).replace(/\.npy$/, "");
    readable(!found.has(name) && (method === 0 || method === DEFLATED), `another array ${name}, or one packed by method ${method}`);
    const stored = bytes.subarray(start, start + long(at + 20));
    const stream = () => new Blob([stored]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    const plain = method ? new Uint8Array(await new Response(stream()).arrayBuffer()) : stored;
    readable(plain.length === long(at + 24), `${plain.length} bytes of ${name}`);
    found.set(name, column(plain));
  }
  return found;
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
function column(bytes) {
  const view = viewOf(bytes), wide = bytes[6] > 1 ? 4 : 2;
  const start = 8 + wide + (wide > 2 ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder().decode(bytes.subarray(8 + wide, start));
  const [, kind, digits] = /'descr': '[<|]([fiuU])(\d+)'/.exec(header) ?? [], width = Number(digits) * (kind === "U" ? 4 : 1);
  const shape = (/'shape': \(([\d, ]*)\)/.exec(header)?.[1].match(/\d+/g) ?? []).map(Number), [rows, columns] = shape;
  const count = shape.reduce((a, b) => a * b, 1), across = header.includes("'fortran_order': True") && shape.length > 1;
  const read = READERS[kind + digits];
  readable(view.getUint32(0) === NUMPY && bytes.length === start + count * width, "an array of another size than it tells");
  readable((read || kind === "U") && (!across || (shape.length === 2 && read)), `an array of another kind: ${header.trim()}`);
  if (!read) return { shape, values: Array.from({ length: count }, (_, k) => text(view, start + width * k, width)) };
  const values = new Float64Array(count);
  for (let k = 0; k < count; k++) values[across ? (k % rows) * columns + Math.floor(k / rows) : k] = read(view, start + k * width);
  return { shape, values };
}

/** @type {(view: DataView, start: number, width: number) => string} */
function text(view, start, width) {
  let found = "";
  for (let at = start; at < start + width; at += 4) if (view.getUint32(at, true)) found += String.fromCodePoint(view.getUint32(at, true));
  return found;
}
