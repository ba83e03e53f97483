"""Strings of angles, the notation of twisty puzzles: ``0 - - - + 0``, one sign for each hinge.

``0`` is straight, ``+`` a quarter turn, ``-`` a quarter turn the other way; white space and commas
between them mean nothing. A file may say in its first line that it is one: ``foldback-angles/1``.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import MAX_CELLS, quote, too_many
from foldback.planner.readers.text import numbered_lines

HEADING: Final = "foldback-angles/1"
QUARTER_TURNS_DEG: Final = {"0": 0.0, "+": 90.0, "-": -90.0, "\u2212": -90.0, "\u2013": -90.0}
"""Hinge angle, in degrees, for each character of a fold written as a string of signs; two
typographic minus signs are included."""
DIGITS_CHECKED: Final = 4096
"""Number of characters at the beginning of a text that are searched for digits only, to recognise
hinge angles written as digits, which are refused with an explanation."""
MAX_COLUMNS: Final = 4
"""Maximum number of columns of a list of cells. A first line with more numbers, or one longer
number alone, counts as angles of a folding puzzle and is refused with an explanation."""
_TURN_NUMBER: Final = re.compile(r"[+\-\u2212]?(?:[0-4]+|90|180|270)(?:\.0*)?")
"""Matches one word of a text of hinge angles as numbers: a run of digits 0 to 4, each of which is
one hinge's quarter turns ('0132'), or an angle of 90, 180 or 270 degrees."""
DECIMAL_COMMAS: Final = re.compile(r"\s*(?:[+-]?[0-9]+,[0-9]+\s+){2}[+-]?[0-9]+,[0-9]+\s*")
"""Matches a line of three numbers with decimal commas and spaces between them. Its digits are
not angles."""
_NO_SEPARATORS: Final = {ord(c): " " for c in ",;"}
_BETWEEN: Final = " \t\r\n,;"
_ALL: Final = re.compile(rf"[{re.escape(''.join(QUARTER_TURNS_DEG) + _BETWEEN)}]*")
_LONE_SIGN: Final = re.compile(r"(?<![^\s,;])[+\-\u2212\u2013](?![^\s,;])|[+\-\u2212\u2013]{2}")


def is_angle_string(text: str) -> bool:
    """Return True if a text has the heading, or only angle signs and is not a list of zeros."""
    return text.startswith(HEADING) or (
        _ALL.fullmatch(text) is not None
        and _LONE_SIGN.search(text) is not None
        and sum(character in QUARTER_TURNS_DEG for character in text) >= 2
    )


def refuse_digits(text: str) -> None:
    """Refuse lines of many digits or quarter turns, which puzzles are also written in.

    Raises:
        InputError: ``digits``.
    """
    words = text[:DIGITS_CHECKED].translate(_NO_SEPARATORS).split()
    first = next((line for _, line in numbered_lines(text) if line.strip()), "")
    if sum(separator in first for separator in ",;\t") > 1:
        return
    if DECIMAL_COMMAS.fullmatch(first):
        raise InputError(
            "not-a-number",
            f"got {quote(first.strip())!r}, expected numbers without decimal commas; write "
            "decimals with a point.",
        )
    has_columns = len(first.translate(_NO_SEPARATORS).split()) > MAX_COLUMNS
    if len(first.split(",")) == 2 * len("xyz") and text.strip().count("\n"):
        return  # a list with decimal commas: the reader of CSV names the line
    run = len(words) == 1 and len(words[0]) > MAX_COLUMNS
    lines = [
        line.translate(_NO_SEPARATORS).split()
        for _, line in numbered_lines(text[:DIGITS_CHECKED])
        if line.strip()
    ]
    has_columns |= len(lines) > MAX_COLUMNS and all(len(line) == 1 for line in lines)
    if (has_columns or run) and all(map(_TURN_NUMBER.fullmatch, words)):
        raise InputError(
            "digits",
            f"got {quote(first.strip())!r}: such numbers are not angles; for each hinge of "
            "tetrahedra, use 0 (straight), + or - (bent); for each joint of a Rubik's snake, use a "
            "digit from 0 to 3.",
        )


def read_angle_string(
    text: str,
    *,
    name: str = "chain",
    most_modules: int = MAX_CELLS,
) -> Chain:
    """Return the chain that a string of angles describes.

    Args:
        text: One sign for each hinge.
        name: Name of the shape.
        most_modules: Maximum number of modules; longer chains are refused.

    Raises:
        InputError: ``stray-character`` with its place, ``wrong-count`` for no sign at all, or
            ``overlap`` with the modules that lie in one another.
    """
    angles: list[float] = []
    for index, character in enumerate(text.removeprefix(HEADING).lstrip("\r\n")):
        if character in _BETWEEN:
            continue
        if character not in QUARTER_TURNS_DEG:
            raise InputError(
                "stray-character",
                f"got {quote(character)} after {len(angles)} angles, expected 0, + or - for each "
                "hinge.",
                where=f"character {index + 1}",
            )
        angles.append(QUARTER_TURNS_DEG[character])
    modules = TETRAHEDRON.module_count(len(angles))
    if modules > most_modules:
        raise too_many(modules, most_modules, "modules")
    return Chain.from_angles(TETRAHEDRON, np.deg2rad(angles), name=name)
