// An isometric drawing of cells, seen from (1, 1, 1); the layer being painted stands out.
import { SIZE, cellOf } from "./painting.js";

const SVG = "http://www.w3.org/2000/svg";
const UNIT = 20;
const COSINE = Math.sqrt(0.75);
/**
 * @param {Vector} cell
 * @returns {[right: number, down: number]}
 */
const project = ([x, y, z]) => [(y - x) * COSINE * UNIT, ((x + y) * 0.5 - z) * UNIT];
/** @param {Vector[]} points */
const path = (points) => `M${points.map((p) => project(p).map((v) => v.toFixed(1)).join(" ")).join("L")}z`;

/**
 * @param {Vector} cell
 * @param {string} axis
 * @param {number} inset
 * @returns {Vector[]}
 */
function face([x, y, z], axis, inset) {
  const a = inset;
  const b = 1 - inset;
  if (axis === "t") return [[x + a, y + a, z + 1], [x + b, y + a, z + 1], [x + b, y + b, z + 1], [x + a, y + b, z + 1]];
  if (axis === "l") return [[x + 1, y + a, z + a], [x + 1, y + b, z + a], [x + 1, y + b, z + b], [x + 1, y + a, z + b]];
  return [[x + a, y + 1, z + a], [x + b, y + 1, z + a], [x + b, y + 1, z + b], [x + a, y + 1, z + b]];
}

/**
 * @param {string} name
 * @param {Record<string, string>} attributes
 */
function made(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

/**
 * @param {SVGSVGElement} svg
 * @param {import("./painting.js").Painting} painting
 * @param {number} layer
 */
export function draw(svg, painting, layer) {
  const cells = [...painting.cells].map(cellOf);
  const top = Math.max(layer, 2, ...cells.map(([, , z]) => z)) + 1;
  const square = (/** @type {number} */ z) => path([[0, 0, z], [SIZE, 0, z], [SIZE, SIZE, z], [0, SIZE, z]]);
  const parts = [made("path", { class: "floor", d: square(0) })];
  cells.sort((p, q) => p[2] - q[2] || p[0] + p[1] - q[0] - q[1]);
  const plane = made("path", { class: "plane", d: square(layer) });
  let planed = false;
  for (const cell of cells) {
    const [x, y, z] = cell;
    if (!planed && z >= layer) { parts.push(plane); planed = true; }
    const group = made("g", /** @type {Record<string, string>} */ (z === layer ? { class: "now" } : {}));
    for (const [axis, hidden] of /** @type {[string, boolean][]} */ ([
      ["l", x + 1 < SIZE && painting.has(x + 1, y, z)],
      ["r", y + 1 < SIZE && painting.has(x, y + 1, z)],
      ["t", z + 1 < SIZE && painting.has(x, y, z + 1)],
    ])) {
      if (hidden) continue;
      group.append(made("path", { class: "gap", d: path(face(cell, axis, 0)) }), made("path", { class: axis, d: path(face(cell, axis, 0.045)) }));
    }
    if (group.childNodes.length) parts.push(group);
  }
  if (!planed) parts.push(plane);
  const wide = SIZE * COSINE * UNIT + 8;
  svg.setAttribute("viewBox", `${-wide} ${-top * UNIT - 8} ${2 * wide} ${(SIZE + top) * UNIT + 16}`);
  svg.replaceChildren(...parts);
}
