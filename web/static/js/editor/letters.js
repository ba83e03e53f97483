// Letters of 5×5 cells, each connected by faces; a number is a row, its bits are the cells.
/** @type {Record<string, string>} */
const ROWS = {
  A: "1f 11 1f 11 11",
  B: "1e 12 1f 11 1f",
  C: "1f 10 10 10 1f",
  D: "1e 13 11 13 1e",
  E: "1f 10 1e 10 1f",
  F: "1f 10 1e 10 10",
  G: "1f 10 17 11 1f",
  H: "11 11 1f 11 11",
  I: "1f 04 04 04 1f",
  J: "01 01 01 11 1f",
  K: "11 13 1e 13 11",
  L: "10 10 10 10 1f",
  M: "1f 15 15 15 15",
  N: "19 1d 15 17 13",
  O: "1f 11 11 11 1f",
  P: "1f 11 1f 10 10",
  Q: "1f 11 11 13 1f",
  R: "1f 11 1e 13 11",
  S: "1f 10 1f 01 1f",
  T: "1f 04 04 04 04",
  U: "11 11 11 11 1f",
  V: "11 11 1b 0e 04",
  W: "15 15 15 15 1f",
  X: "11 1b 0e 1b 11",
  Y: "11 1b 0e 04 04",
  Z: "1f 03 0e 18 1f",
};

// Return the cells (row, column) of a letter.
/**
 * @param {string} letter
 * @returns {[row: number, column: number][]}
 */
export function letterCells(letter) {
  return ROWS[letter]
    .split(" ")
    .flatMap((row, x) =>
      [0, 1, 2, 3, 4]
        .filter((y) => parseInt(row, 16) & (16 >> y))
        .map((y) => /** @type {[number, number]} */ ([x, y])),
    );
}
