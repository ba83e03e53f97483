"""Names of axes in the header of a list of cells."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import quote
from foldback.planner.readers.text import is_number

AXES: Final = ("x", "y", "z")
OTHER_AXES: Final = ("ijk", "abc", "uvw")
"""Alternative column names for the coordinates x, y and z, one letter each; accepted if a list's
header names none of x, y and z."""
OCCUPANCY_COLUMNS: Final = frozenset(
    ("value", "filled", "occupied", "occupancy", "solid", "voxel", "active")
)
"""Names of columns that state if a cell is filled; a 0 in such a column is refused, as only
filled cells are expected."""
WORD: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
MINUS_SIGNS: Final = ("-", "\u2212")


def columns_of(headers: Sequence[str]) -> tuple[int, ...] | None:
    """Return the columns of x, y and z by their headers; None unless each is named exactly once.

    Args:
        headers: One text a column: an axis, beside a unit or another word. A header with a minus
            sign before it names no axis: its column would have to be turned.
    """
    if any(header.strip().startswith(MINUS_SIGNS) for header in headers):
        return None
    axes = [_axis_of(header, AXES) for header in headers]
    for names in OTHER_AXES:
        axes = axes if any(axes) else [_axis_of(header, tuple(names)) for header in headers]
    if all(axes.count(axis) == 1 for axis in AXES):
        return tuple(axes.index(axis) for axis in AXES)
    words = [header.strip() for header in headers]
    for end in (0, -1):
        letters = [word[end].casefold() for word in words if word]
        if len(words) == 3 and sorted(letters) == list(AXES):
            return tuple(letters.index(axis) for axis in AXES)
    return None


def _axis_of(header: str, names: Sequence[str]) -> str:
    """Return the axis that a header names under one of three names; empty if none or several."""
    words = [word.casefold() for word in WORD.findall(header)]
    axes = [AXES[names.index(word)] for word in words if word in names]
    return axes[0] if len(axes) == 1 else ""


def check_filled(fields: Sequence[str], headers: Sequence[str], line: int) -> None:
    """Refuse a row that says its cell is empty.

    Args:
        fields: A row.
        headers: The columns' names.
        line: Number of its line.

    Raises:
        InputError: ``empty-cell``.
    """
    for header, field in zip(headers, fields, strict=False):
        if header.casefold() in OCCUPANCY_COLUMNS and is_number(field) and float(field) == 0.0:
            raise InputError(
                "empty-cell",
                f"got 0 in the column {quote(header)!r}, expected only filled cells; remove "
                "the rows of empty cells.",
                where=f"line {line}",
            )
