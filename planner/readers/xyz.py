"""XYZ: triples separated by white space, plain or as chemists write them.

The chemists' files begin with a line that holds the count and a line of comment; their rows may
begin with the name of an element.
"""

from __future__ import annotations

from typing import Final

from planner.chain.path import Path
from planner.errors import InputError
from planner.readers.limits import Source, quote, too_many
from planner.readers.text import COMMENT, cells_array, coordinate, is_number, path_or_shape
from planner.shapes.shape import Shape

AXES: Final = ("x", "y", "z")
DIGITS_OF_A_COUNT: Final = 9


def is_xyz(text: str) -> bool:
    """Return True if the first line of data is a count, or words of which two are numbers."""
    for line in text.splitlines():
        words = line.split()
        if words and not _is_comment(words):
            return _count(words) is not None or sum(map(is_number, words)) >= 2
    return False


def read_xyz(text: str, source: Source) -> Path | Shape:
    """A path from white-space separated triples.

    Raises:
        InputError: Naming the line.
    """
    lines = [line.split() for line in text.splitlines()]
    first = next((i for i, words in enumerate(lines) if words and not _is_comment(words)), 0)
    promised = _count(lines[first]) if lines else None
    start = 0 if promised is None else first + 2
    rows: list[list[float]] = []
    for index in range(start, len(lines)):
        words = lines[index]
        if not words or _is_comment(words):
            continue
        if promised is not None and len(words) == 4 and words[0].isalnum():
            words = words[1:]
        if len(words) != 3:
            raise _wrong_width(words, index + 1)
        rows.append([coordinate(w, a, index + 1) for w, a in zip(words, AXES, strict=True)])
        if len(rows) > source.most_cells:
            raise too_many(len(rows), source.most_cells)
    if promised is not None and promised != len(rows):
        code = "truncated" if len(rows) < promised else "wrong-count"
        raise InputError(
            code,
            f"got {len(rows)} cells after a first line that promises {promised}; "
            "the file is cut, or more than one frame.",
            where=f"line {first + 1}",
        )
    return path_or_shape(cells_array(rows), source)


def _is_comment(words: list[str]) -> bool:
    return words[0].startswith(COMMENT)


def _count(words: list[str]) -> int | None:
    if len(words) == 1 and words[0].isascii() and words[0].isdigit():
        return int(words[0][: DIGITS_OF_A_COUNT + 1])
    return None


def _wrong_width(words: list[str], line: int) -> InputError:
    return InputError(
        "wrong-count",
        f"got {quote(' '.join(words[:12]))!r}, expected three whole numbers: x y z.",
        where=f"line {line}",
    )
