// The table that a chain folds on: its colours by the page's theme, and the discs that tell how hard
// modules press on it.
// `top` and `edge` are what a drawing has, `lit` what becomes the same in the 3D view's light.
/** @type {Record<"light" | "dark", { lit: Colour, top: Colour, edge: Colour }>} */
const COLOURS = {
  light: { lit: [206, 190, 166], top: [222, 214, 200], edge: [184, 172, 152] }, // as web/pictures/table_top.py
  dark: { lit: [62, 68, 77], top: [76, 83, 93], edge: [50, 56, 64] },
};
const ABOVE = 0.02; // pitches that the lowest disc is above the table
const APART = 0.002; // and the next one above it, so that none flickers
const AREA = 0.62; // radius of a disc, in pitches, of a module that presses with its own weight
const LEAST = 0.05; // weights; what presses less has no disc
const NOWHERE = -1e6;

const light = matchMedia("(prefers-color-scheme: light)");

// What the table looks like now.
export function tableColours() {
  const { theme } = document.documentElement.dataset;
  return COLOURS[theme === "light" || theme === "dark" ? theme : light.matches ? "light" : "dark"];
}

// Discs whose areas are the forces of the table under the modules, in the scene's units.
/**
 * @param {Numbers} pressed weights of a module, NaN where that is not known
 * @param {Numbers} positions
 * @param {number} height
 * @param {number} pitch
 */
export function discs(pressed, positions, height, pitch) {
  const n = pressed.length;
  const places = new Float32Array(3 * n);
  const scales = new Float32Array(n);
  let standing = 0;
  for (let i = 0; i < n; i++) {
    if (!(pressed[i] > LEAST)) { places[3 * i + 2] = NOWHERE; continue; }
    places[3 * i] = positions[3 * i] * pitch;
    places[3 * i + 1] = positions[3 * i + 1] * pitch;
    places[3 * i + 2] = (height + ABOVE + APART * standing++) * pitch;
    scales[i] = AREA * Math.sqrt(pressed[i]);
  }
  return { places, scales };
}
