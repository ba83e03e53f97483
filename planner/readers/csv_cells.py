"""CSV: one cell a line, separated by commas, semicolons or tabs, with or without a header."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Final

from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.readers.axis_names import AXES, check_filled, columns_of
from foldback.planner.readers.limits import Source, quote, too_many
from foldback.planner.readers.text import (
    COMMENT_MARK,
    cells_array,
    coordinate,
    is_number,
    numbered_lines,
    path_or_shape,
)
from foldback.planner.shapes.shape import Shape

DELIMITERS: Final = (";", "\t", ",")
EXCEL_SEPARATOR_PREFIX: Final = "sep="
"""Beginning of a CSV file's first line in which Excel states the separator; that line is
skipped."""


def is_csv(text: str) -> bool:
    """Return True if the first line of data holds a CSV separator."""
    return _delimiter(_first_line(text)) is not None


def read_csv(text: str, source: Source) -> Path | Shape:
    """Return a path from CSV. A header that names x, y and z picks those columns.

    The header may be a comment, as NumPy writes it.

    Raises:
        InputError: A line cannot be read; names it.
    """
    first = _first_line(text)
    delimiter = _delimiter(first) or ","
    if first.count(delimiter) >= 1000:  # three are used
        raise InputError(
            "wrong-count",
            f"got a list of {first.count(delimiter) + 1} columns, expected three: x, y and z.",
        )
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    columns: tuple[int, ...] | None = None
    headers: list[str] = []
    is_first = True
    rows: list[list[float]] = []
    try:
        for fields in reader:
            line = reader.line_num
            fields = _without_empty_tail(fields)
            if not any(f.strip() for f in fields):
                continue
            if _is_remark(fields[0]):
                if is_first and len(fields) == len(AXES):
                    columns = columns_of([fields[0].lstrip(" #"), *fields[1:]]) or columns
                continue
            if is_first:
                is_first = False
                headers = _headers(fields)
                if headers:
                    columns = _columns(headers)
                    continue
            if len(headers) > len(AXES):
                _check_reach(fields, columns or (), line)
                check_filled(fields, headers, line)
            else:
                _check_width(fields, line)
            words = [fields[column] for column in columns or range(len(AXES))]
            if delimiter != ",":
                words = [word.replace(",", ".") for word in words]
            rows.append([coordinate(w, a, line) for w, a in zip(words, AXES, strict=True)])
            if len(rows) > source.max_cells:
                raise too_many(len(rows), source.max_cells)
    except csv.Error as error:
        raise InputError(
            "bad-csv",
            f"this line is not valid CSV ({error}); expected three whole numbers in each line.",
            where=f"line {reader.line_num}",
        ) from error
    return path_or_shape(cells_array(rows), source)


def _first_line(text: str) -> str:
    lines = (line for _, line in numbered_lines(text) if not _is_remark(line))
    return next((line for line in lines if line.strip()), "")


def _is_remark(line: str) -> bool:
    start = line.lstrip()
    return (
        start.startswith(COMMENT_MARK)
        or start[: len(EXCEL_SEPARATOR_PREFIX)].lower() == EXCEL_SEPARATOR_PREFIX
    )


def _delimiter(line: str) -> str | None:
    for delimiter in DELIMITERS:
        if delimiter in line.strip():
            return delimiter
    return None


def _headers(fields: list[str]) -> list[str]:
    """Return the columns' names, or none when the fields are data."""
    if any(is_number(field.replace(",", ".")) for field in fields):
        return []
    return [field.strip().strip('"') for field in fields]


def _columns(headers: list[str]) -> tuple[int, ...]:
    """Return the columns of x, y and z.

    Raises:
        InputError: ``bad-header`` unless each of them is named exactly once.
    """
    columns = columns_of(headers)
    if columns is None:
        raise InputError(
            "bad-header",
            f"got the columns {quote(', '.join(headers))!r}, expected one column each for x, y "
            "and z.",
            where="the header",
        )
    return columns


def _without_empty_tail(fields: list[str]) -> list[str]:
    return fields[:-1] if len(fields) == 4 and not fields[-1].strip() else fields


def _check_width(fields: list[str], line: int) -> None:
    if len(fields) != len(AXES):
        raise InputError(
            "wrong-count",
            f"got {len(fields)} field{'' if len(fields) == 1 else 's'} "
            f"({quote(', '.join(fields[:6]))}), expected three: x, y and z; if the file has "
            "more columns, add a header line that names x, y and z.",
            where=f"line {line}",
        )


def _check_reach(fields: list[str], columns: Sequence[int], line: int) -> None:
    if len(fields) <= max(columns):
        raise InputError(
            "wrong-count",
            f"got {len(fields)} fields, expected at least {max(columns) + 1}, as in the header.",
            where=f"line {line}",
        )
