// Isometric drawing of cells, viewed from (1, 1, 1), with the current layer highlighted and the
// path on top. Only visible faces are drawn: a full grid needs no more elements than its surface.
import { svg } from "../lib/text.js";
import { cellOf, keysOf } from "./painting.js";

const UNIT = 20;
const COSINE = Math.sqrt(0.75);
const SIDES = ["l", "r", "t"];
/** Visible corners of a face, by the bits of its visible halves. */
const SEEN = [[], [0, 1, 2], [0, 2, 3], [0, 1, 2, 3]];
/** Colours along the path, from its first module to its last, as in previews: cividis. */
const ALONG = [
  "#00224e",
  "#123570",
  "#3b496c",
  "#575d6d",
  "#707173",
  "#8a8678",
  "#a59c74",
  "#c3b369",
  "#e1cc55",
  "#fee838",
];
/** @type {Record<string, number>} */
const SHADES = { t: 1, l: 0.82, r: 0.66 };

/** @param {number[]} cell */
const project = ([x, y, z]) => [(y - x) * COSINE * UNIT, ((x + y) * 0.5 - z) * UNIT];
/** @param {number[][]} points */
const line = (points) =>
  `M${points
    .map((point) =>
      project(point)
        .map((v) => v.toFixed(1))
        .join(" "),
    )
    .join("L")}`;

// Return the corners of a face; the diagonal from the first to the third divides it into halves.
/**
 * @param {Vector} cell
 * @param {string} side
 */
function corners([x, y, z], side) {
  if (side === "t")
    return [
      [x, y, z + 1],
      [x + 1, y, z + 1],
      [x + 1, y + 1, z + 1],
      [x, y + 1, z + 1],
    ];
  if (side === "l")
    return [
      [x + 1, y, z],
      [x + 1, y + 1, z],
      [x + 1, y + 1, z + 1],
      [x + 1, y, z + 1],
    ];
  return [
    [x, y + 1, z],
    [x + 1, y + 1, z],
    [x + 1, y + 1, z + 1],
    [x, y + 1, z + 1],
  ];
}

// Return the visible halves of faces. Projected along (1, 1, 1), a
// cell's faces cover six triangles of the plane, which are halves of its
// squares (x - z, y - z). In each triangle the nearest cell is visible.
/**
 * @param {number[]} keys
 * @param {number} size
 * @returns {Map<number, number>} bits of the visible halves, by 3 × key + face
 */
export function visible(keys, size) {
  const wide = 2 * size + 1;
  const nearest = new Int32Array(2 * wide * wide).fill(-1);
  const owner = new Int32Array(2 * wide * wide);
  /**
   * @param {number} a
   * @param {number} b
   * @param {number} half
   * @param {number} depth
   * @param {number} face
   */
  const cover = (a, b, half, depth, face) => {
    const place = 2 * ((a + size) * wide + b + size) + half;
    if (depth > nearest[place]) {
      nearest[place] = depth;
      owner[place] = face;
    }
  };
  for (const key of keys) {
    const [x, y, z] = cellOf(key, size);
    const [a, b, depth] = [x - z, y - z, x + y + z];
    const first = 6 * key;
    cover(a, b, 0, depth, first); // l: the half before its diagonal, then the other one
    cover(a, b - 1, 1, depth, first + 1);
    cover(a, b, 1, depth, first + 2); // r
    cover(a - 1, b, 0, depth, first + 3);
    cover(a - 1, b - 1, 0, depth, first + 4); // t
    cover(a - 1, b - 1, 1, depth, first + 5);
  }
  /** @type {Map<number, number>} */
  const halves = new Map();
  owner.forEach((half, place) => {
    if (nearest[place] >= 0)
      halves.set(half >> 1, (halves.get(half >> 1) ?? 0) | (1 << (half & 1)));
  });
  return halves;
}

// Return the colour of a module along the path, shaded by side.
/**
 * @param {number} step index into ALONG
 * @param {string} side
 */
function colour(step, side) {
  const parts = [1, 3, 5].map((k) =>
    Math.round(parseInt(ALONG[step].slice(k, k + 2), 16) * SHADES[side]),
  );
  return `rgb(${parts.join(" ")})`;
}

/**
 * @param {SVGSVGElement} picture
 * @param {Painted} painted
 * @param {number} layer
 * @param {DrawnPath | null} drawn the path, if it is displayed
 */
export function draw(picture, { cells, size }, layer, drawn) {
  const keys = keysOf(cells);
  const highest = keys.length ? cellOf(keys[keys.length - 1], size)[2] : 0;
  const top = Math.max(layer, 2, highest) + 1;
  const path = drawn?.path ?? [];
  const place = new Map(
    path.map((key, index) => [key, Math.floor((ALONG.length * index) / path.length)]),
  );

  // Faces of the same style share one element.
  /** @type {Map<string, string[]>[]} faces below the layer; those in it and above */
  const storeys = [new Map(), new Map()];
  for (const [face, halves] of visible(keys, size)) {
    const key = Math.floor(face / 3);
    const side = SIDES[face % 3];
    const cell = cellOf(key, size);
    const step = place.get(key);
    const look = `${side} ${step ?? (cell[2] === layer && !path.length ? "now" : "")}`;
    const storey = storeys[cell[2] < layer ? 0 : 1];
    const all = corners(cell, side);
    const text = `${line(SEEN[halves].map((k) => all[k]))}z`;
    const texts = storey.get(look);
    if (texts) texts.push(text);
    else storey.set(look, [text]);
  }
  const faces = storeys.map((storey) =>
    [...storey].map(([look, texts]) => {
      const [side, step] = look.split(" ");
      const coloured = /\d/.test(step);
      const part = svg("path", {
        class: coloured ? "face" : `face ${side} ${step}`,
        d: texts.join(""),
      });
      if (coloured) part.setAttribute("fill", colour(Number(step), side));
      return part;
    }),
  );
  const square = (/** @type {number} */ z) =>
    `${line([
      [0, 0, z],
      [size, 0, z],
      [size, size, z],
      [0, size, z],
    ])}z`;
  const parts = [
    svg("path", { class: "floor", d: square(0) }),
    ...faces[0],
    svg("path", { class: "plane", d: square(layer) }),
    ...faces[1],
  ];
  if (drawn && path.length) parts.push(...course(drawn, size));
  const wide = size * COSINE * UNIT + 8;
  picture.setAttribute(
    "viewBox",
    `${-wide} ${-top * UNIT - 8} ${2 * wide} ${(size + top) * UNIT + 16}`,
  );
  picture.replaceChildren(...parts);
}

// Return the path as a line through the centres of its
// cells, with marks at its first cell and its drawn end.
/**
 * @param {DrawnPath} drawn
 * @param {number} size
 */
function course({ path, atStart }, size) {
  const middles = path.map((key) => cellOf(key, size).map((v) => v + 0.5));
  const d = line(middles);
  const spot = (/** @type {number[]} */ middle, /** @type {string} */ name) => {
    const [cx, cy] = project(middle);
    return svg("circle", { class: name, cx, cy, r: 0.22 * UNIT * Math.max(1, size / 16) });
  };
  const [first, head] = [middles[0], middles[atStart ? 0 : middles.length - 1]];
  return [
    svg("path", { class: "course casing", d }),
    svg("path", { class: "course", d }),
    spot(first, "first"),
    spot(head, "head"),
  ];
}
