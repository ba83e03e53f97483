"""OFF: counts, then vertices, then polygons, as text."""

from __future__ import annotations

import re
from typing import Final, TypeAlias

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, check_lines, parse_float, parse_int, quote
from foldback.planner.readers.number_rows import NumberRows, chunks, parse_rows, whole
from foldback.planner.readers.text import BYTE_LINE, data_start, numbered_lines, without_comments
from foldback.planner.shapes.polygons import MIN_CORNERS, fans, skipped_note
from foldback.planner.shapes.solid import Solid, check_triangles

KIND: Final = re.compile(rb"\s*((?:ST)?C?N?4?n?OFF)(?=[\s#\d]|$)")
"""Matches the keyword. Counts may follow it without a space, as in the ModelNet data sets."""
MAX_POLYGON_CORNERS: Final = 10_000
"""Maximum number of corners of one polygon of an OFF mesh; a larger number counts as damage and the
file is refused."""

Mesh: TypeAlias = "tuple[Array, Ints, Ints, int]"
"""Points (V, 3), corners of all polygons, (P,) corners of each polygon, number of extra lines."""


def is_off(data: bytes) -> bool:
    """Return True if the first word is an OFF keyword."""
    data_begin = data_start(data)
    return KIND.match(data[data_begin : data_begin + 64]) is not None


def read_off(data: bytes, source: Source) -> Solid:
    """Return the solid in an OFF file; colours and normals are ignored.

    Raises:
        InputError: A line cannot be read or the variant of OFF is not supported; names it.
    """
    check_lines(data, source.max_triangles)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = without_comments(data)
    keyword = KIND.match(data)
    assert keyword is not None
    kind = keyword[1].decode("latin-1")
    end = data.find(b"\n", keyword.end())
    at = len(data) if end < 0 else end + 1
    first = data[keyword.end() : at].decode("latin-1").split()
    number = data.count(b"\n", 0, at)
    if "4" in kind or "n" in kind:
        raise InputError(
            "unsupported", f"{kind} meshes are not supported; save the mesh as plain OFF."
        )
    if first[:1] == ["BINARY"]:
        raise InputError("unsupported", "this is a binary OFF mesh; save it as text.")
    if not first:
        first, at, number = _words(data, at, number)
    if not first:
        raise InputError(
            "truncated",
            f"the file ends after {kind}; expected the counts of vertices and polygons.",
        )
    vertices, polygons = _counts(number, first)
    body = memoryview(data)[at:]
    lines = data.count(b"\n", at) + 1
    if vertices + polygons > lines:
        raise _truncated(lines, vertices, polygons)
    check_triangles(polygons, source.max_triangles)
    mesh_data = _many(bytes(body), vertices, polygons) or _one_by_one(
        bytes(body), number, vertices, polygons
    )
    points, corners, counts, extra_lines = mesh_data
    notes = skipped_note(int((counts < MIN_CORNERS).sum()))
    return Solid.from_triangles(
        points,
        fans(corners, counts),
        name=source.name or "solid",
        notes=(*notes, "lines after the last polygon were ignored.") if extra_lines else notes,
        max_triangles=source.max_triangles,
    )


def _words(data: bytes, at: int, number: int) -> tuple[list[str], int, int]:
    """Return the words of the next non-empty line, the offset after it, and its number."""
    line = BYTE_LINE.search(data, at)
    if line is None:
        return [], len(data), number
    number += data.count(b"\n", at, line.start()) + 1
    return line[0].decode("latin-1").split(), line.end() + 1, number


def _truncated(lines: int, vertices: int, polygons: int) -> InputError:
    return InputError(
        "truncated",
        f"got {lines} lines after the counts, expected a line for each of {vertices} vertices and "
        f"{polygons} polygons; save or send the file again.",
    )


def _many(body: bytes, vertices: int, polygons: int) -> Mesh | None:
    """Parse all lines at once; None if they hold anything but numbers."""
    blocks: list[NumberRows] = []
    for chunk in chunks(body):
        ended = chunk if chunk.endswith(b"\n") else chunk + b"\n"
        part = parse_rows(np.frombuffer(ended, dtype=np.uint8))
        if part is None:
            return None
        blocks.append(NumberRows(values=part.values, counts=part.counts[part.counts > 0]))
    values = np.concatenate([part.values for part in blocks])
    counts = np.concatenate([part.counts for part in blocks])
    del blocks
    if len(counts) < vertices + polygons:
        return None
    cut = int(counts[:vertices].sum())
    points = NumberRows(values=values[:cut], counts=counts[:vertices]).columns(0, 3)
    faces = NumberRows(values=values[cut:], counts=counts[vertices:])
    starts = faces.starts[:polygons]
    sizes = whole(faces.values[starts])
    if points is None or sizes is None or not len(sizes):
        return None
    good = (sizes >= 0) & (sizes <= MAX_POLYGON_CORNERS) & (sizes < faces.counts[:polygons])
    if not good.all():
        return None
    ends = np.cumsum(sizes)
    places = np.arange(int(ends[-1])) + np.repeat(starts + 1 - (ends - sizes), sizes)
    corners = whole(faces.values[places])
    if corners is None:
        return None
    extra_lines = len(counts) - vertices - polygons
    return np.ascontiguousarray(points), corners, sizes, extra_lines


def _one_by_one(body: bytes, number: int, vertices: int, polygons: int) -> Mesh:
    """Parse line by line, so that an error can name its line."""
    lines = [
        (number + n, words)
        for n, line in numbered_lines(body.decode("latin-1"))
        if (words := line.split())
    ]
    if vertices + polygons > len(lines):
        raise _truncated(len(lines), vertices, polygons)
    points: list[list[float]] = []
    flat: list[int] = []
    counts: list[int] = []
    number = 0
    try:
        for number, words in lines[:vertices]:  # noqa: B007
            points.append([parse_float(words[0]), parse_float(words[1]), parse_float(words[2])])
        for number, words in lines[vertices : vertices + polygons]:  # noqa: B007
            corners = parse_int(words[0])
            if not 0 <= corners <= MAX_POLYGON_CORNERS or corners >= len(words):
                raise ValueError(
                    f"a polygon declares {quote(words[0])} corners, but lists {len(words) - 1}"
                )
            flat += [parse_int(word) for word in words[1 : corners + 1]]
            counts.append(corners)
        rows = np.array(flat, dtype=np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        problem = "too few numbers, or numbers that are too large"
        if isinstance(error, ValueError):
            problem = str(error)
        raise InputError(
            "damaged",
            f"got {problem}; expected the three coordinates of a vertex, or the number of a "
            "polygon's corners and then a vertex number for each corner.",
            where=f"line {number}",
        ) from error
    extra_lines = len(lines) - vertices - polygons
    return np.array(points).reshape(-1, 3), rows, np.array(counts, dtype=np.int64), extra_lines


def _counts(number: int, words: list[str]) -> tuple[int, int]:
    if len(words) < 2 or not all(w.isascii() and w.isdigit() and len(w) < 12 for w in words[:2]):
        raise InputError(
            "damaged",
            f"got {quote(' '.join(words[:4]))!r}, expected the counts of vertices and polygons.",
            where=f"line {number}",
        )
    return int(words[0]), int(words[1])
