// Reads a file of NumPy arrays: a zip archive whose members are .npy files. Files come from
// strangers, and readers differ in what they make of doubled names, gaps, odd types and the like;
// so a file with any of these is refused, as by foldback_check.py. Sizes are compared with bounds
// before memory is used.

/**
 * @typedef {{ shape: number[], kind: string, columns: boolean, start: number }} Header `columns`:
 *   values are in the order of columns
 */

/** Something that is no plan. */
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
 * Return a stranger's text in quotes: printable ASCII, everything else escaped, shortened.
 * @param {unknown} value
 */
export function quoted(value) {
  const text = typeof value === "string" ? value : (JSON.stringify(value) ?? "nothing"),
    short = text.length > 60 ? `${text.slice(0, 57)}...` : text;
  return JSON.stringify(short).replace(
    /[^ -~]/g,
    (c) => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`,
  );
}

const MEMBER = 0x504b0304,
  ENTRY = 0x504b0102,
  END = 0x504b0506,
  NUMPY = 0x934e554d,
  DEFLATED = 8,
  LONG = 2 ** 32 - 1;
const MAX_FILE = 2 ** 30,
  MAX_ARRAY = 2 ** 28,
  MAX_UTF32 = 2 ** 26; // bytes: of a file, an array, a text in it
const FLAGS = 0x806; // of a member: level of compression, names in UTF-8
const HEAD = 4096; // bytes in which a header ends
/** @type {Record<string, string>} NumPy type of each array that is read, little-endian */
export const TYPES = {
  plan: "U",
  joint_names: "U",
  time_s: "f8",
  first: "i8",
  offsets: "i8",
  joint_angles_rad: "f8",
  angles_rad: "f4",
  angle_planes: "u1",
};
/**
 * @type {Record<string, new (buffer: ArrayBuffer) => Iterable<number | bigint> & {
 *   length: number }>}
 */
const NUMBERS = { f8: Float64Array, f4: Float32Array, u1: Uint8Array, i8: BigInt64Array };
const NAME = /^[A-Za-z0-9_]{1,64}\.npy$/;
const HEADER =
  // eslint-disable-next-line max-len -- a regular expression cannot be broken
  /^\{'descr': '[<|](f8|f4|i8|u1|U\d{1,9})', 'fortran_order': (False|True), 'shape': \((|\d{1,9},|\d{1,9}, \d{1,9})\), \} *\n$/;
const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

/** @param {Uint8Array} bytes */
const crc32 = (bytes) =>
  ~bytes.reduce((crc, byte) => CRC[(crc ^ byte) & 255] ^ (crc >>> 8), -1) >>> 0;
/** @type {(bytes: Uint8Array) => string} each byte as one letter */
const letters = (bytes) => Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");

export class Archive {
  /** @param {Uint8Array<ArrayBuffer>} bytes */
  constructor(bytes) {
    readable(
      bytes.length >= 22 && bytes.length <= MAX_FILE,
      "this is no zip archive, or a huge one",
    );
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength),
      end = bytes.length - 22;
    const short = (/** @type {number} */ at) => view.getUint16(at, true),
      long = (/** @type {number} */ at) => view.getUint32(at, true);
    const alike = (
      /** @type {number} */ a,
      /** @type {number} */ b,
      /** @type {number} */ length,
    ) => Array.from({ length }, (_, k) => bytes[a + k] === bytes[b + k]).every(Boolean);
    readable(
      view.getUint32(end) === END &&
        !long(end + 4) &&
        short(end + 8) === short(end + 10) &&
        !short(end + 20),
      "this is no zip archive, or something follows it",
    );
    /**
     * @type {Map<string, { method: number, crc: number, size: number,
     *   packed: Uint8Array<ArrayBuffer> }>}
     */
    this.members = new Map();
    let at = long(end + 16),
      place = 0;
    for (let k = short(end + 10); k > 0; k--) {
      const flags = short(at + 8),
        method = short(at + 10),
        crc = long(at + 16),
        packed = long(at + 20),
        size = long(at + 24),
        length = short(at + 28),
        memberStart = long(at + 42);
      const name = letters(bytes.subarray(at + 46, at + 46 + length)),
        start = memberStart + 30 + length,
        packedSize = long(memberStart + 18),
        fullSize = long(memberStart + 22);
      const sizes =
        packedSize === LONG && fullSize === LONG
          ? long(start) === 0x100001 &&
            view.getBigUint64(start + 4, true) === BigInt(size) &&
            view.getBigUint64(start + 12, true) === BigInt(packed)
          : packedSize === packed && fullSize === size;
      readable(
        view.getUint32(at) === ENTRY &&
          view.getUint32(memberStart) === MEMBER &&
          alike(at + 6, memberStart + 4, 14) &&
          short(memberStart + 26) === length &&
          alike(at + 46, memberStart + 30, length) &&
          NAME.test(name) &&
          !this.members.has(name) &&
          memberStart === place &&
          !(flags & ~FLAGS) &&
          [0, DEFLATED].includes(method) &&
          sizes,
        `the member ${quoted(name)} of the archive is not as usual, or its headers differ`,
      );
      const from = start + short(memberStart + 28);
      place = from + packed;
      this.members.set(name, { method, crc, size, packed: bytes.subarray(from, place) });
      at += 46 + length + short(at + 30) + short(at + 32);
    }
    readable(place === long(end + 16) && at === end, "the archive has gaps");
  }

  /** @param {string} name of an array */
  has(name) {
    return this.members.has(`${name}.npy`);
  }

  /** @param {string} name of an array */
  member(name) {
    const member = this.members.get(`${name}.npy`);
    readable(member, `the array ${name} is missing`);
    return member;
  }

  /**
   * Return a member's first bytes.
   * @param {string} name
   * @param {number} maxBytes
   */
  async unpacked(name, maxBytes) {
    const { method, size, packed } = this.member(name),
      bytes = new Uint8Array(Math.min(maxBytes, size + 1));
    if (!method) return packed.slice(0, maxBytes);
    const reader = new Blob([packed])
      .stream()
      .pipeThrough(new DecompressionStream("deflate-raw"))
      .getReader();
    try {
      for (let at = 0; at < bytes.length;) {
        const { done, value } = await reader.read();
        if (done) return bytes.slice(0, at);
        bytes.set(value.subarray(0, bytes.length - at), at);
        at += value.length;
      }
      await reader.cancel();
    } catch {
      throw new Unreadable(`the array ${name} is damaged`);
    }
    return bytes;
  }

  /**
   * Return the header of an array, which has a fair size.
   * @param {string} name
   * @returns {Promise<Header>}
   */
  async header(name) {
    const head = await this.unpacked(name, HEAD),
      { size } = this.member(name),
      type = TYPES[name],
      start = 10 + head[8] + 256 * head[9];
    const match =
      new DataView(head.buffer).getUint32(0) === NUMPY &&
      letters(head.subarray(4, 8)) === "PY\x01\x00" &&
      HEADER.exec(letters(head.subarray(10, start)));
    readable(
      match && match[1].startsWith(type),
      `the array ${name} has an unexpected type or header`,
    );
    const [, kind, columns] = match,
      shape = (match[3].match(/\d+/g) ?? []).map(Number);
    const bytes =
      start + shape.reduce((a, b) => a * b, 1) * Number(kind.slice(1)) * (type === "U" ? 4 : 1);
    readable(
      size === bytes && size <= (type === "U" ? MAX_UTF32 : MAX_ARRAY),
      `the array ${name} does not have the size that its header states, or a huge one`,
    );
    return { kind, columns: columns === "True", shape, start };
  }

  /**
   * Return the shape of an array.
   * @param {string} name
   * @param {number} dimensions
   */
  async shape(name, dimensions) {
    const { shape } = await this.header(name);
    readable(shape.length === dimensions, `the array ${name} has the shape (${shape})`);
    return shape;
  }

  /**
   * @param {string} name
   * @param {number[]} expected shape
   */
  async data(name, expected) {
    const header = await this.header(name),
      { size, crc } = this.member(name);
    readable(
      `${header.shape}` === `${expected}`,
      `the array ${name} has the shape (${header.shape}), expected (${expected})`,
    );
    const bytes = await this.unpacked(name, size + 1);
    readable(bytes.length === size && crc32(bytes) === crc, `the array ${name} is damaged`);
    return { ...header, bytes: bytes.slice(header.start).buffer };
  }

  /**
   * Return an array of this shape, in the order of rows.
   * @param {string} name
   * @param {number[]} expected
   */
  async numbers(name, ...expected) {
    const { kind, columns, bytes } = await this.data(name, expected),
      values = Float64Array.from(new NUMBERS[kind](bytes), Number),
      [rows, across] = expected;
    return columns && across
      ? values.map((_, k) => values[(k % across) * rows + Math.floor(k / across)])
      : values;
  }

  /**
   * Return texts.
   * @param {string} name
   * @param {number[]} expected shape
   */
  async texts(name, ...expected) {
    const { kind, bytes } = await this.data(name, expected),
      codes = new Uint32Array(bytes),
      width = Number(kind.slice(1));
    readable(
      codes.every((code) => code < 0xd800 || (code > 0xdfff && code < 0x110000)),
      `the array ${name} has letters that do not exist`,
    );
    return Array.from({ length: expected[0] ?? 1 }, (_, k) => {
      let text = "",
        end = (k + 1) * width;
      while (end > k * width && !codes[end - 1]) end--;
      for (let at = k * width; at < end; at += HEAD)
        text += String.fromCodePoint(...codes.subarray(at, Math.min(at + HEAD, end)));
      return text;
    });
  }
}
