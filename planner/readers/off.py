"""OFF: counts, then vertices, then polygons, as text."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.polygons import fans_of_rows
from planner.solids import Solid, check_triangles

KIND: Final = re.compile(r"(?:ST)?C?N?OFF(?=[\s#]|$)")
MOST_CORNERS: Final = 10_000


def is_off(data: bytes) -> bool:
    """Whether the first word is that of OFF files."""
    start = data[:64].lstrip(b"\xef\xbb\xbf \t\r\n")
    return KIND.match(start.decode("latin-1")) is not None


def read_off(data: bytes, source: Source) -> Solid:
    """A solid from an OFF file; colours and normals are left alone.

    Raises:
        InputError: Naming the line, or what kind of mesh this is.
    """
    text = data.decode("latin-1").lstrip("ï»¿")
    lines = [
        (number, words)
        for number, line in enumerate(text.splitlines(), 1)
        if (words := line.partition("#")[0].split())
    ]
    kind = lines[0][1].pop(0)
    if lines[0][1][:1] == ["BINARY"]:
        raise InputError("unsupported", "this is a binary OFF mesh; save it as text.")
    if not lines[0][1]:
        lines.pop(0)
    if not lines:
        raise InputError("truncated", f"the file ends after {kind}; expected the counts.")
    vertices, polygons = _counts(*lines[0])
    if vertices + polygons > len(lines) - 1:
        raise InputError(
            "truncated",
            f"got {len(lines) - 1} lines after the counts, expected {vertices} vertices and "
            f"{polygons} polygons.",
        )
    check_triangles(polygons, source.most_triangles)
    points: list[list[float]] = []
    rows: list[list[int]] = []
    number = 0
    try:
        for number, words in lines[1 : vertices + 1]:  # noqa: B007
            points.append([float(words[0]), float(words[1]), float(words[2])])
        for number, words in lines[vertices + 1 : vertices + polygons + 1]:  # noqa: B007
            corners = int(words[0])
            if not 0 <= corners <= MOST_CORNERS or corners >= len(words):
                raise ValueError(f"a polygon of {quote(words[0])} corners")
            rows.append([int(word) for word in words[1 : corners + 1]])
        triangles = fans_of_rows(rows)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(
            "damaged",
            f"{quote(str(error))}; expected three coordinates, or a count and as many corners.",
            where=f"line {number}",
        ) from error
    return Solid.from_triangles(
        np.array(points).reshape(-1, 3),
        triangles,
        name=source.name or "solid",
        most_triangles=source.most_triangles,
    )


def _counts(number: int, words: list[str]) -> tuple[int, int]:
    if len(words) < 2 or not all(w.isascii() and w.isdigit() and len(w) < 12 for w in words[:2]):
        raise InputError(
            "damaged",
            f"got {quote(' '.join(words[:4]))!r}, expected the counts of vertices and polygons.",
            where=f"line {number}",
        )
    return int(words[0]), int(words[1])
