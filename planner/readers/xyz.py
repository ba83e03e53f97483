"""XYZ: triples separated by white space, plain or as chemists write them.

The chemists' files begin with a line that holds the count and a line of comment; their rows may
begin with the name of an element. Other files may begin with a line that names the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from planner.chain.path import Path
from planner.errors import InputError
from planner.readers.axis_names import AXES, check_filled, columns_of
from planner.readers.limits import Source, quote, too_many
from planner.readers.text import COMMENT_MARK, cells_array, coordinate, is_number, path_or_shape
from planner.shapes.shape import Shape

MAX_COUNT_DIGITS: Final = 9
"""Maximum number of digits of the first line of an XYZ file that states the number of points. A
longer number is cut to one digit more, so that parsing stays fast and the number matches no file.
Chosen."""


def is_xyz(text: str) -> bool:
    """Return True if the first line of data is a count, or words of which two are numbers.

    A line of columns' names may stand before it.
    """
    begins_with_names = False
    for line in text.splitlines():
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
    lines = [line.split() for line in text.splitlines()]
    first = next((i for i, words in enumerate(lines) if words and not _is_comment(words)), 0)
    promised = _count(lines[first]) if lines else None
    headers = _headers(lines[first]) if lines else []
    columns = columns_of(headers) or _commented_columns(lines[:first])
    start = first + 1 if headers else first
    if promised is not None:
        following = sum(1 for words in lines[first + 1 :] if words and not _is_comment(words))
        # Some programs leave the line of comment out.
        start = first + 1 if following == promised else first + 2
    rows: list[list[float]] = []
    for index in range(start, len(lines)):
        words = lines[index]
        if not words or _is_comment(words):
            continue
        if promised is not None and len(words) == 4 and words[0].isalnum():
            words = words[1:]
        if len(words) != (len(headers) or len(AXES)):
            raise _wrong_width(words, headers or AXES, index + 1)
        check_filled(words, headers, index + 1)
        words = [words[column] for column in columns] if columns else words
        rows.append([coordinate(w, a, index + 1) for w, a in zip(words, AXES, strict=True)])
        if len(rows) > source.most_cells:
            raise too_many(len(rows), source.most_cells)
    if promised is not None and promised != len(rows):
        code = "truncated" if len(rows) < promised else "wrong-count"
        raise InputError(
            code,
            f"the first line declares {promised} cells, but the file has {len(rows)}; "
            "the file is cut off, or has more than one frame.",
            where=f"line {first + 1}",
        )
    return path_or_shape(cells_array(rows), source)


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
        return int(words[0][: MAX_COUNT_DIGITS + 1])
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
