// Titles and captions of a film, drawn once each as transparent pictures.

const TITLE_SHARE = 1 / 15; // letter height of a title, as a fraction of the picture's shorter side
const CAPTION_SHARE = 1 / 26; // the same of a caption
const LINE_HEIGHT = 1.35; // in letters
const MAX_LINES = 4; // of a caption
const MAX_TITLE_LINES = 2;
const SIDE = 0.06; // fraction of the picture's width that stays free on each side
const TOP = 0.06; // fraction of the picture's height above a title
const BELOW = 0.05; // the same below a caption

// Return the lines of a text that fit a width. A text that is too long ends with "…".
/**
 * @param {string} text
 * @param {(text: string) => number} measure returns the width of a text
 * @param {{ width: number, lines: number }} room
 */
export function linesOf(text, measure, { width, lines: most }) {
  /** @type {string[]} */
  const lines = [];
  for (const word of text.split(/\s+/).filter(Boolean)) {
    const longer = lines.length ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length && measure(longer) <= width) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  const shown = lines.slice(0, most);
  return shown.map((line, k) =>
    fitting(k === most - 1 && lines.length > most ? `${line} …` : line, measure, width),
  );
}

/**
 * @param {string} line
 * @param {(text: string) => number} measure
 * @param {number} width
 */
function fitting(line, measure, width) {
  if (measure(line) <= width) return line;
  const letters = [...line.replace(/ …$/, "")];
  while (letters.length > 1 && measure(`${letters.join("")}…`) > width) letters.pop();
  return `${letters.join("")}…`;
}

/**
 * @typedef {{ width: number, height: number, dark: boolean, family: string }} Look size of the
 *   film, its theme and its font
 * @typedef {{ image: ImageBitmap, y: number }} Text picture with a text, and its upper edge
 */

/**
 * @param {string} text
 * @param {Look} look
 * @returns {Promise<Text>}
 */
export async function titleText(text, { width, height, dark, family }) {
  const letter = Math.round(TITLE_SHARE * Math.min(width, height));
  const { pen, lines } = prepared(text, `650 ${letter}px ${family}`, width, MAX_TITLE_LINES);
  const step = Math.round(LINE_HEIGHT * letter);
  resize(pen, width, Math.max(1, lines.length * step));
  pen.fillStyle = dark ? "rgb(240 238 233)" : "rgb(28 31 36)";
  write(pen, lines, step, 0);
  return { image: await createImageBitmap(pen.canvas), y: Math.round(TOP * height) };
}

/**
 * @param {string} text
 * @param {Look} look
 * @returns {Promise<Text>}
 */
export async function captionText(text, { width, height, dark, family }) {
  const letter = Math.max(11, Math.round(CAPTION_SHARE * Math.min(width, height)));
  const pad = Math.round(0.8 * letter);
  const font = `500 ${letter}px ${family}`;
  const { pen, lines } = prepared(text, font, width - 2 * pad, MAX_LINES);
  const step = Math.round(LINE_HEIGHT * letter);
  const widest = Math.max(...lines.map((line) => pen.measureText(line).width));
  const tall = lines.length * step + 2 * pad;
  resize(pen, width, tall);
  pen.fillStyle = dark ? "rgb(24 26 30 / .86)" : "rgb(252 251 249 / .9)";
  pen.beginPath();
  pen.roundRect((width - widest) / 2 - 1.5 * pad, 0, widest + 3 * pad, tall, pad);
  pen.fill();
  pen.fillStyle = dark ? "rgb(240 238 233)" : "rgb(28 31 36)";
  write(pen, lines, step, pad);
  const y = Math.round(height * (1 - BELOW)) - tall;
  return { image: await createImageBitmap(pen.canvas), y };
}

/**
 * @param {string} text
 * @param {string} font
 * @param {number} width
 * @param {number} most lines
 */
function prepared(text, font, width, most) {
  const pen = /** @type {CanvasRenderingContext2D} */ (
    document.createElement("canvas").getContext("2d")
  );
  pen.font = font;
  const measure = (/** @type {string} */ part) => pen.measureText(part).width;
  return { pen, lines: linesOf(text, measure, { width: width * (1 - 2 * SIDE), lines: most }) };
}

// Give a canvas its size; its font stays.
/**
 * @param {CanvasRenderingContext2D} pen
 * @param {number} width
 * @param {number} height
 */
function resize(pen, width, height) {
  const { font } = pen;
  Object.assign(pen.canvas, { width, height });
  pen.font = font;
}

/**
 * @param {CanvasRenderingContext2D} pen
 * @param {string[]} lines
 * @param {number} step
 * @param {number} top
 */
function write(pen, lines, step, top) {
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  lines.forEach((line, k) => pen.fillText(line, pen.canvas.width / 2, top + (k + 0.5) * step));
}
