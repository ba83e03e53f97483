"""Limits of all readers, and the error messages that they share."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.shapes.shape import MAX_CELLS

MAX_TRIANGLES: Final = 2_000_000
"""Maximum number of triangles of an input mesh; one with more is refused."""
SPARE_LINES: Final = 10_000
"""Number of lines that a text file may have in addition to the allowance for each cell."""
MAX_QUOTE_CHARACTERS: Final = 40
"""Maximum length, in characters, of text from an input file that an error message quotes; the rest
is cut off."""

DECIMAL_COMMA: Final = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?\Z")
"""Matches a number with a decimal comma, as some languages write it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Options and limits of a reader besides the content of the file.

    Attributes:
        name: Name of the shape where the file has none; may be empty.
        max_cells: Maximum number of cells or modules.
        max_triangles: Maximum number of triangles.
        as_voxels: True to read lists of cells as voxels in no order.
    """

    name: str
    max_cells: int = MAX_CELLS
    max_triangles: int = MAX_TRIANGLES
    as_voxels: bool = False


def quote(value: object) -> str:
    """Return a short printable form of a value for a message."""
    text = value if isinstance(value, str) else repr(value)
    printable = "".join(c if c.isprintable() else "·" for c in text[: MAX_QUOTE_CHARACTERS + 1])
    return f"{printable[:MAX_QUOTE_CHARACTERS]}…" if len(text) > MAX_QUOTE_CHARACTERS else printable


def described(value: object) -> str:
    """Return a short form of a JSON value for a message, as it stands in the file."""
    match value:
        case str():
            return f'the text "{quote(value)}"'
        case bool() | None:
            return json.dumps(value)
        case _:
            return quote(value)


def parse_float(word: str | bytes) -> float:
    """Return the number in a word of a mesh file.

    Python's ``float`` also accepts underscores and digits of other scripts, which no format allows.

    Raises:
        ValueError: The word is not a number; the message tells people what was found.
    """
    text = word if isinstance(word, str) else word.decode("latin-1")
    try:
        if text.isascii() and "_" not in text:
            return float(text)
    except ValueError:
        pass
    raise ValueError(_no_number(text))


def parse_int(word: str | bytes) -> int:
    """Return the whole number in a word of a mesh file.

    Raises:
        ValueError: The word is not a whole number; the message tells people what was found.
    """
    text = word if isinstance(word, str) else word.decode("latin-1")
    try:
        if text.isascii() and "_" not in text:
            return int(text)
    except ValueError:
        pass
    raise ValueError(f"{quote(text)!r} where a whole number is needed")


def _no_number(text: str) -> str:
    problem = f"{quote(text)!r} where a number is needed"
    return f"{problem} (write decimals with a point)" if DECIMAL_COMMA.match(text) else problem


def megabytes(count: int) -> str:
    """Return the size of a file in MB (2²⁰ bytes) or bytes as text."""
    return f"{count / 2**20:.3g} MB" if count >= 2**17 else f"{count} bytes"


def check_bytes(data: bytes, max_bytes: int) -> None:
    """Refuse empty files and files of more than ``max_bytes`` bytes.

    Raises:
        InputError: ``empty`` or ``too-large``.
    """
    if not data:
        raise InputError("empty", "got an empty file, expected cells, joint angles or a mesh.")
    if len(data) > max_bytes:
        raise InputError(
            "too-large",
            f"got {megabytes(len(data))}, expected at most {megabytes(max_bytes)}; simplify the "
            "model.",
        )


def check_size(data: bytes, max_cells: int) -> None:
    """Refuse text files that are too large for ``max_cells`` cells.

    Raises:
        InputError: ``too-large``.
    """
    max_bytes = 65_536 + 96 * max_cells  # headings and comments, and each cell
    if len(data) > max_bytes:
        raise InputError(
            "too-large",
            f"got {megabytes(len(data))}, expected at most {megabytes(max_bytes)}, which is "
            f"enough for {max_cells} cells; use a coarser shape.",
        )
    # one of data, the others comments or blank
    lines, max_lines = line_ends(data), SPARE_LINES + 4 * max_cells
    if lines > max_lines:
        raise InputError(
            "too-large",
            f"got {lines} lines, expected at most {max_lines}; remove blank lines and comments, "
            "or use a coarser shape.",
        )


def check_lines(data: bytes, max_triangles: int) -> None:
    """Refuse meshes written as text in more lines than ``max_triangles`` triangles need.

    Raises:
        InputError: ``too-large``.
    """
    # the triangle, and its vertices, normals and texture coordinates
    lines, max_lines = line_ends(data), SPARE_LINES + 4 * max_triangles
    if lines > max_lines:
        raise InputError(
            "too-large",
            f"got {lines} lines, expected at most {max_lines}; remove blank lines and comments, or "
            "simplify the mesh.",
        )


def line_ends(data: bytes) -> int:
    """Return the number of line ends of a text file, be they CR, LF or both."""
    return max(data.count(b"\n"), data.count(b"\r"))


def too_many(count: int, max_count: int, noun: str = "cells") -> InputError:
    """Return the error for more cells than the limit."""
    return InputError(
        "too-many-cells",
        f"got {count} {noun}, expected at most {max_count}; use a coarser shape.",
    )
