// Decoding of a binary message into a header and
// arrays; web/timeline/columns.py defines its format.
const TYPES = {
  "<f8": Float64Array,
  "<f4": Float32Array,
  "|u1": Uint8Array,
  "<u2": Uint16Array,
  "<u4": Uint32Array,
  "<i4": Int32Array,
};

/**
 * @template {Message<object, Record<string, Column>>} [Told=Message<Record<string, unknown>,
 *   Record<string, Column>>]
 * @param {ArrayBuffer} buffer
 * @returns {Promise<Told>}
 */
export async function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  /** @type {{ columns: ColumnTold[] }} */
  const { columns, ...header } = JSON.parse(
    new TextDecoder().decode(new Uint8Array(buffer, 4, length)),
  );
  /** @type {Record<string, Column>} */
  const arrays = {};
  await Promise.all(
    columns.map(async (description) => {
      arrays[description.name] = await column(description, buffer, 4 + length);
    }),
  );
  return /** @type {Told} */ (/** @type {unknown} */ ({ header, arrays }));
}

/**
 * @param {ColumnTold} told
 * @param {ArrayBuffer} buffer
 * @param {number} start
 * @returns {Promise<Column>}
 */
async function column({ dtype, shape, at, size, step, differences = 0, short }, buffer, start) {
  const Type = TYPES[dtype];
  const count = shape.reduce((a, b) => a * b, 1);
  if (size === undefined) return new Type(buffer, start + at, count);
  const planes = await inflated(new Uint8Array(buffer, start + at, size));
  const width = Type.BYTES_PER_ELEMENT;
  const bytes = new Uint8Array(count * width);
  for (let b = 0; b < width; b++)
    for (let i = 0, from = b * count; i < count; i++) bytes[i * width + b] = planes[from + i];
  const values = new Type(bytes.buffer);
  if (!short && step === undefined) return values;
  const floats = new Float32Array(count);
  if (short) {
    const bits = new Uint32Array(floats.buffer);
    for (let i = 0; i < count; i++) bits[i] = values[i] << 16;
    return floats;
  }
  const row = shape.length > 1 ? count / (shape[0] || 1) : 1;
  for (let i = 0; i < count; i++) values[i] = (values[i] >>> 1) ^ -(values[i] & 1);
  for (let d = 0; d < differences; d++)
    for (let i = row; i < count; i++) values[i] += values[i - row];
  for (let i = 0; i < count; i++) floats[i] = values[i] * (step ?? 1);
  return floats;
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
