"""OFF: counts, then vertices, then polygons, as text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import Final

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.meshes import check_plain, load
from planner.shapes.solid import Solid, check_triangles

KIND: Final = re.compile(r"(?:ST)?C?N?OFF(?=[\s#]|$)")
COMMENT: Final = re.compile(rb"#[^\n]*")
MOST_CORNERS: Final = 10_000
"""Of one polygon."""

Line = tuple[int, list[bytes]]
"""A line's number in the file, from 1, and its words."""


def is_off(data: bytes) -> bool:
    """Whether the first word is that of OFF files."""
    start = data[:64].lstrip(b"\xef\xbb\xbf \t\r\n")
    return KIND.match(start.decode("latin-1")) is not None


def read_off(data: bytes, source: Source) -> Solid:
    """A solid from an OFF file; colours and normals are left alone.

    Raises:
        InputError: Naming the line, or what kind of mesh this is.
    """
    data = data.lstrip(b"\xef\xbb\xbf")
    if b"#" in data:
        data = COMMENT.sub(b"", data)
    check_plain(data)
    lines = _lines(data)
    number, (kind, *counts) = next(lines)
    if counts[:1] == [b"BINARY"]:
        raise InputError("unsupported", "this is a binary OFF mesh; save it as text.")
    if not counts:
        number, counts = next(lines, (number, []))
    if not counts:
        raise InputError("truncated", f"the file ends after {kind.decode()}; expected the counts.")
    vertices, polygons = _counts(number, counts)
    held = sum(1 for _ in lines)
    if vertices + polygons > held:
        raise InputError(
            "truncated",
            f"got {held} lines after the counts, expected {vertices} vertices and {polygons} "
            "polygons.",
        )
    check_triangles(polygons, source.most_triangles)
    body = (line for line in _lines(data) if line[0] > number)
    for line, words in islice(body, vertices):
        if len(words) < 3:
            raise _damaged(line, words)
    triangles = sum(max(0, _corners(line) - 2) for line in islice(body, polygons))
    return load(data, "off", source, triangles=triangles)


def _lines(data: bytes) -> Iterator[Line]:
    """The lines that hold words."""
    for number, line in enumerate(data.split(b"\n"), 1):
        if words := line.split():
            yield number, words


def _corners(line: Line) -> int:
    """How many corners a polygon has; its line holds them."""
    number, words = line
    size = words[0]
    corners = int(size) if size.isdigit() and len(size) < 6 else MOST_CORNERS + 1
    if corners > MOST_CORNERS or corners >= len(words):
        raise _damaged(number, words)
    return corners


def _counts(number: int, words: list[bytes]) -> tuple[int, int]:
    if len(words) < 2 or not all(word.isdigit() and len(word) < 12 for word in words[:2]):
        raise InputError(
            "damaged",
            f"got {quote(b' '.join(words[:4]).decode('latin-1'))!r}, expected the counts of "
            "vertices and polygons.",
            where=f"line {number}",
        )
    return int(words[0]), int(words[1])


def _damaged(number: int, words: list[bytes]) -> InputError:
    return InputError(
        "damaged",
        f"got {quote(b' '.join(words[:6]).decode('latin-1'))!r}, expected three coordinates, or a "
        "count and as many corners.",
        where=f"line {number}",
    )
