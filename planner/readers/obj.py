"""OBJ: lines of vertices and polygons; materials, normals and curves are left alone."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.polygons import fans
from planner.readers.tables import SPACE, chunks, line_starts, lines_of, table, whole
from planner.shapes.solid import Solid, check_triangles

VERTEX_LINE: Final = re.compile(rb"(?m)^\s*v[ \t]+[-+.\dnNiI]")
INDENT: Final = re.compile(rb"(?m)^[ \t]+")
TEXTURE: Final = re.compile(rb"/\S*")
LOOKED_AT: Final = 65_536
TAB: Final = 9

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """What some lines hold: points, and corners of polygons counted from the file's first point."""

    points: NDArray[np.float64]
    corners: Ints
    counts: Ints


def is_obj(data: bytes) -> bool:
    """Whether a line near the beginning is a vertex as OBJ files have it."""
    start = data[:LOOKED_AT]
    return start.lstrip()[:1] not in (b"{", b"[") and VERTEX_LINE.search(start) is not None


def read_obj(data: bytes, source: Source) -> Solid:
    """A solid from an OBJ file. Nothing that it refers to is looked for.

    Raises:
        InputError: Naming the line.
    """
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    parts: list[_Part] = []
    known = lines = triangles = 0
    for chunk in chunks(data):
        part = _many(chunk, known) or _one_by_one(chunk, known, lines)
        parts.append(part)
        known += len(part.points)
        lines += chunk.count(b"\n")
        triangles += int(np.maximum(part.counts - 2, 0).sum())
        check_triangles(max(1, triangles), source.most_triangles)
    faces = fans(
        np.concatenate([part.corners for part in parts]),
        np.concatenate([part.counts for part in parts]),
    )
    points = np.concatenate([part.points for part in parts])
    del parts
    return Solid.from_triangles(
        points,
        faces,
        name=source.name or "solid",
        most_triangles=source.most_triangles,
    )


def _many(chunk: bytes, known: int) -> _Part | None:
    """All lines at once; None when one of them is not as they usually are."""
    text = np.frombuffer(chunk if chunk.endswith(b"\n") else chunk + b"\n", dtype=np.uint8)
    starts = line_starts(text)
    if np.isin(text[starts], (SPACE, TAB)).any():
        return _many(INDENT.sub(b"", chunk), known) if INDENT.search(chunk) else None
    after = text[np.minimum(starts + 1, len(text) - 1)]
    spaced = (after == SPACE) | (after == TAB)
    of_points = spaced & (text[starts] == ord("v"))
    of_faces = spaced & (text[starts] == ord("f"))
    bare = text.copy()
    bare[starts[of_points | of_faces]] = SPACE
    points = table(lines_of(bare, starts, of_points))
    face_lines = lines_of(bare, starts, of_faces)
    if (face_lines == ord("/")).any():
        face_lines = np.frombuffer(TEXTURE.sub(b"", face_lines.tobytes()), dtype=np.uint8)
    faces = table(face_lines)
    if points is None or faces is None or len(faces.counts) != int(of_faces.sum()):
        return None
    places = points.columns(0, 3)
    corners = whole(faces.values)
    if places is None or corners is None or (corners == 0).any():
        return None
    # A negative number counts back from the last point before its line.
    so_far = known + np.cumsum(of_points)[of_faces]
    back = corners < 0
    if back.any():
        corners = np.where(back, corners + np.repeat(so_far, faces.counts), corners - 1)
    else:
        corners -= 1
    return _Part(points=np.ascontiguousarray(places), corners=corners, counts=faces.counts)


def _one_by_one(chunk: bytes, known: int, lines: int) -> _Part:
    """Line by line, which tells where something is wrong."""
    points: list[tuple[float, float, float]] = []
    corners: list[int] = []
    counts: list[int] = []
    number = 0
    try:
        for number, line in enumerate(chunk.decode("latin-1").split("\n"), lines + 1):  # noqa: B007
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                points.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[0] == "f":
                row = [int(word.partition("/")[0]) for word in words[1:]]
                if 0 in row:
                    raise ValueError("corner 0")
                so_far = known + len(points)
                corners += [corner - 1 if corner > 0 else so_far + corner for corner in row]
                counts.append(len(row))
        flat = np.array(corners, dtype=np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(
            "damaged",
            f"{quote(str(error))}; expected 'v x y z', or 'f' and the numbers of vertices.",
            where=f"line {number}",
        ) from error
    return _Part(
        points=np.array(points, dtype=np.float64).reshape(-1, 3),
        corners=flat,
        counts=np.array(counts, dtype=np.int64),
    )
