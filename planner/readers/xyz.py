"""XYZ: triples separated by white space, plain or as chemists write them.

The chemists' files begin with a line that holds the count and a line of comment; their rows may
begin with the name of an element. Other files may begin with a line that names the columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, islice
from typing import TypeAlias

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

Line: TypeAlias = "tuple[int, list[str]]"
"""Number and words of a line."""


def is_xyz(text: str) -> bool:
    """Return True if the first line of data is a count, or words of which two are numbers.

    A line of columns' names may stand before it.
    """
    begins_with_names = False
    for _, line in numbered_lines(text):
        words = line.split()
        if not words or _is_comment(words):
            continue
        if not begins_with_names and _headers(words):
            begins_with_names = True
            continue
        is_count = _count(words) is not None and not begins_with_names
        return is_count or sum(map(is_number, words)) >= 2
    return False


def read_xyz(text: str, source: Source) -> Path | Shape:
    """Return a path from triples separated by white space.

    Raises:
        InputError: A line cannot be read; names it.
    """
    lines = ((n, words) for n, line in numbered_lines(text) if (words := line.split()))
    comments, first_line, first = _head(lines)
    promised = _count(first)
    headers = _headers(first)
    columns = columns_of(headers) or _commented_columns(comments)
    data = lines if headers or promised is not None else chain([(first_line, first)], lines)
    data = ((n, words) for n, words in data if not _is_comment(words))
    if promised is not None:
        data = _after_remark(list(islice(data, source.max_cells + 2)), first_line, promised)
    rows: list[list[float]] = []
    for line, words in data:
        if promised is not None and len(words) == 4 and words[0].isalnum():
            words = words[1:]
        if len(words) != (len(headers) or len(AXES)):
            raise _wrong_width(words, headers or AXES, line)
        check_filled(words, headers, line)
        words = [words[column] for column in columns] if columns else words
        rows.append([coordinate(w, a, line) for w, a in zip(words, AXES, strict=True)])
        if len(rows) > source.max_cells:
            raise too_many(len(rows), source.max_cells)
    if promised is not None and promised != len(rows):
        code = "truncated" if len(rows) < promised else "wrong-count"
        raise InputError(
            code,
            f"the first line declares {promised} cells, but the file has {len(rows)}; "
            "the file is cut off, or has more than one frame.",
            where=f"line {first_line}",
        )
    return path_or_shape(cells_array(rows), source)


def _head(lines: Iterator[Line]) -> tuple[list[list[str]], int, list[str]]:
    """Return the comments before the data, and the first line of data with its number."""
    comments: list[list[str]] = []
    for number, words in lines:
        if not _is_comment(words):
            return comments, number, words
        comments.append(words)
    return comments, 0, []


def _after_remark(lines: list[Line], count_line: int, promised: int) -> list[Line]:
    """Return the lines after that of the count without the remark, which some programs leave out.

    Args:
        lines: Lines after that of the count, without comments.
        count_line: Number of the line with the count.
        promised: The count.
    """
    if len(lines) == promised or not lines or lines[0][0] > count_line + 1:
        return lines
    return lines[1:]


def _headers(words: list[str]) -> list[str]:
    """Return the columns' names, without units; none unless they name x, y and z."""
    if any(map(is_number, words)):
        return []
    headers = [word for word in words if word[0] not in "[("]
    return [] if columns_of(headers) is None else headers


def _commented_columns(comments: list[list[str]]) -> tuple[int, ...] | None:
    """Return the columns of x, y and z if one of the comments before the data names them."""
    headers = [" ".join(words).lstrip("# ").split() for words in comments]
    candidates = [columns_of(words) for words in headers if len(words) == len(AXES)]
    return next((columns for columns in candidates if columns is not None), None)


def _is_comment(words: list[str]) -> bool:
    return words[0].startswith(COMMENT_MARK)


def _count(words: list[str]) -> int | None:
    if len(words) == 1 and words[0].isascii() and words[0].isdigit():
        return int(words[0][:10])  # a longer number is cut, and matches no file
    return None


def _wrong_width(words: list[str], headers: Sequence[str], line: int) -> InputError:
    expected = "three whole numbers: x y z"
    if len(headers) > len(AXES):
        expected = f"{len(headers)} values, one for each name in the header"
    return InputError(
        "wrong-count",
        f"got {quote(' '.join(words[:12]))!r}, expected {expected}.",
        where=f"line {line}",
    )
