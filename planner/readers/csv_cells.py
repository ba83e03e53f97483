"""CSV: one cell a line, separated by commas, semicolons or tabs, with or without a header."""

from __future__ import annotations

import csv
import re
from typing import Final

from planner.chain.path import Path
from planner.errors import InputError
from planner.readers.limits import Source, quote, too_many
from planner.readers.text import COMMENT, cells_array, coordinate, is_number, path_or_shape
from planner.shapes.shape import Shape

DELIMITERS: Final = (";", "\t", ",")
AXES: Final = ("x", "y", "z")
INDEX_AXES: Final = {"i": "x", "j": "y", "k": "z"}
HEADER_WORD: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def is_csv(text: str) -> bool:
    """Whether the first line of data holds a separator of CSV files."""
    return _delimiter(_first_line(text)) is not None


def read_csv(text: str, source: Source) -> Path | Shape:
    """A path from CSV. A header that names x, y and z picks those columns.

    Raises:
        InputError: Naming the line.
    """
    delimiter = _delimiter(_first_line(text)) or ","
    reader = csv.reader(text.splitlines(), delimiter=delimiter, skipinitialspace=True)
    columns: tuple[int, ...] | None = None
    rows: list[list[float]] = []
    try:
        for fields in reader:
            line = reader.line_num
            if not any(f.strip() for f in fields) or fields[0].lstrip().startswith(COMMENT):
                continue
            if columns is None:
                columns = _header(fields)
                if columns is not None:
                    continue
                columns = (0, 1, 2)
                _check_width(fields, line)
            if columns == (0, 1, 2):
                fields = _without_empty_tail(fields)
                _check_width(fields, line)
            else:
                _check_reach(fields, columns, line)
            words = [fields[column] for column in columns]
            if delimiter != ",":
                words = [word.replace(",", ".") for word in words]
            rows.append([coordinate(w, a, line) for w, a in zip(words, AXES, strict=True)])
            if len(rows) > source.most_cells:
                raise too_many(len(rows), source.most_cells)
    except csv.Error as error:
        raise InputError(
            "bad-csv",
            f"{error}; expected three whole numbers in each line.",
            where=f"line {reader.line_num}",
        ) from error
    return path_or_shape(cells_array(rows), source)


def _first_line(text: str) -> str:
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith(COMMENT):
            return line
    return ""


def _delimiter(line: str) -> str | None:
    for delimiter in DELIMITERS:
        if delimiter in line.strip():
            return delimiter
    return None


def _header(fields: list[str]) -> tuple[int, ...] | None:
    """Return the columns of x, y and z when the fields are words; None when they are data.

    Raises:
        InputError: ``bad-header`` when they name some of the axes only, or one of them twice.
    """
    if any(is_number(field.replace(",", ".")) for field in fields):
        return None
    words = [f.strip().strip('"') for f in fields]
    axes = [_axis_of(word, {}) for word in words]
    if not any(axes):
        axes = [_axis_of(word, INDEX_AXES) for word in words]
    if all(axes.count(axis) == 1 for axis in AXES):
        return tuple(axes.index(axis) for axis in AXES)
    for at in (0, -1):
        letters = [word[at : len(word) + at + 1 if at else 1].casefold() for word in words if word]
        if len(words) == 3 and sorted(letters) == list(AXES):
            return tuple(letters.index(axis) for axis in AXES)
    if len(words) == 3 and all(words) and not any(axes):
        return (0, 1, 2)
    raise InputError(
        "bad-header",
        f"got the columns {quote(', '.join(words))!r}, expected one named x, one y and one z.",
        where="the header",
    )


def _axis_of(header: str, names: dict[str, str]) -> str:
    """Return the axis that a column's header names, beside a unit or another word; empty if none.

    Args:
        header: Words in a column's first line.
        names: Other names of the axes.
    """
    parts = [part.casefold() for part in HEADER_WORD.findall(header)]
    axes = [names.get(part, part) for part in parts]
    named = [axis for axis in axes if axis in AXES]
    return named[0] if len(named) == 1 else ""


def _without_empty_tail(fields: list[str]) -> list[str]:
    return fields[:-1] if len(fields) == 4 and not fields[-1].strip() else fields


def _check_width(fields: list[str], line: int) -> None:
    if len(_without_empty_tail(fields)) != len(AXES):
        raise InputError(
            "wrong-count",
            f"got {len(fields)} field{'' if len(fields) == 1 else 's'} "
            f"({quote(', '.join(fields[:6]))}), expected x, y, z; with more columns, name them in "
            "a header line.",
            where=f"line {line}",
        )


def _check_reach(fields: list[str], columns: tuple[int, ...], line: int) -> None:
    if len(fields) <= max(columns):
        raise InputError(
            "wrong-count",
            f"got {len(fields)} fields, expected at least {max(columns) + 1} as in the header.",
            where=f"line {line}",
        )
