// Arrays and a few words about them from one binary message; web/columns.py tells its form.
const TYPES = {
  "<f8": Float64Array, "<f4": Float32Array, "|u1": Uint8Array, "<u2": Uint16Array, "<u4": Uint32Array, "<i4": Int32Array,
};

export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const { columns, ...header } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = {};
  for (const { name, dtype, shape, at } of columns) {
    arrays[name] = new TYPES[dtype](buffer, 4 + length + at, shape.reduce((a, b) => a * b, 1));
  }
  return { header, arrays };
}
