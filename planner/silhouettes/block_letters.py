"""Block letters: capitals of Latin, Greek, Cyrillic and Hebrew, drawn in cells."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags

LETTER_HEIGHT: Final = 5
"""Height of letters without marks, in cells."""
FILE: Final = Path(__file__).with_name("block_letters.txt")
LOOKALIKES: Final = dict(
    zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧАВЕКМНОРСТХГЗІЅЈПФШẞı", "ABEZHIKMNOPTYXABEKMHOPCTXΓ3ISJΠΦWSI", strict=True)
)
"""Letters that are drawn like another one."""
MARKS: Final = {
    "\N{COMBINING DIAERESIS}": ("#.#",),
    "\N{COMBINING DOT ABOVE}": (".#.",),
    "\N{COMBINING ACUTE ACCENT}": (".##", ".#."),
    "\N{GREEK TONOS}": (".##", ".#."),
    "\N{COMBINING GRAVE ACCENT}": ("##.", ".#."),
    "\N{COMBINING CIRCUMFLEX ACCENT}": ("###", ".#."),
    "\N{COMBINING TILDE}": (".##", "##."),
    "\N{COMBINING MACRON}": ("###", ".#."),
    "\N{COMBINING CARON}": ("#.#", "###", ".#."),
    "\N{COMBINING BREVE}": ("#.#", "###", ".#."),
    "\N{COMBINING RING ABOVE}": ("###", "#.#"),
    "\N{COMBINING DOUBLE ACUTE ACCENT}": ("#.#",),
}
"""Drawings of marks above a letter."""


def drawing_of(letter: str) -> Flags | None:
    """Return the (rows, columns) cells of a letter; None if there is no drawing of it.

    The last ``LETTER_HEIGHT`` rows are the letter, those above are its marks.
    """
    drawings = _drawings()
    plain = LOOKALIKES.get(letter, letter)
    if plain in drawings:
        return drawings[plain]
    base, *marks = unicodedata.normalize("NFD", letter)
    base = LOOKALIKES.get(base, base)
    if base not in drawings or not marks:
        return None
    drawing = drawings[base]
    for mark in marks:
        if mark not in MARKS:
            return None
        drawing = _with_mark(drawing, _cells(MARKS[mark]))
    return drawing


def _with_mark(letter: Flags, mark: Flags) -> Flags:
    """Return a letter with a mark that stands on the cell of its top row nearest to the middle."""
    width = letter.shape[1]
    top = np.flatnonzero(letter[0])
    column = int(top[np.argmin(np.abs(top - (width - 1) / 2))])
    feet = np.flatnonzero(mark[-1])
    if len(feet) > 1 and letter[0].all():
        # Dots, a ring or a tilde on a flat top: in the middle, or at both ends of it.
        first = (width - mark.shape[1]) // 2
    else:
        first = column - int(feet[len(feet) // 2])
    left, right = max(0, -first), max(0, first + mark.shape[1] - width)
    rows = np.zeros((len(mark), left + width + right), dtype=np.bool_)
    rows[:, left + first : left + first + mark.shape[1]] = mark
    return np.vstack([rows, np.pad(letter, ((0, 0), (left, right)))])


@cache
def _drawings() -> Mapping[str, Flags]:
    """Return all drawn letters; read once."""
    lines = FILE.read_text(encoding="utf-8").splitlines()
    groups = [list(group) for has_text, group in groupby(lines, bool) if has_text]
    drawings: dict[str, Flags] = {}
    for letters, *rows in groups[1:]:  # the first one is a text
        starts = [column for column, letter in enumerate(letters) if letter != " "]
        for start, end in zip(starts, [*starts[1:], None], strict=True):
            drawing = _cells(tuple(row[start:end].rstrip() for row in rows))
            rows_used = np.flatnonzero(drawing.any(axis=1))
            height = max(LETTER_HEIGHT, int(rows_used[-1]) + 1)
            drawings[letters[start]] = drawing[:height]
    return drawings


def _cells(rows: tuple[str, ...]) -> Flags:
    width = max(map(len, rows))
    cells = np.array([[cell == "#" for cell in row.ljust(width)] for row in rows])
    return cells[:, : np.flatnonzero(cells.any(axis=0))[-1] + 1]
