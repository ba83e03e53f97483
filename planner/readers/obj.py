"""OBJ: lines of vertices and polygons; materials, normals and curves are left alone."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.polygons import fans_of_rows
from planner.solids import Solid

VERTEX_LINE: Final = re.compile(rb"(?m)^\s*v[ \t]+[-+.\dnNiI]")
LOOKED_AT: Final = 65_536


def is_obj(data: bytes) -> bool:
    """Whether a line near the beginning is a vertex as OBJ files have it."""
    start = data[:LOOKED_AT]
    return start.lstrip()[:1] not in (b"{", b"[") and VERTEX_LINE.search(start) is not None


def read_obj(data: bytes, source: Source) -> Solid:
    """A solid from an OBJ file. Nothing that it refers to is looked for.

    Raises:
        InputError: Naming the line.
    """
    text = data.decode("latin-1").replace("\\\r\n", " ").replace("\\\n", " ")
    points: list[tuple[float, float, float]] = []
    rows: list[list[int]] = []
    triangles = number = 0
    try:
        for number, line in enumerate(text.split("\n"), 1):  # noqa: B007
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                points.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[0] == "f":
                del words[0]
                if "/" in line:
                    words = [word.partition("/")[0] for word in words]
                row = list(map(int, words))
                if 0 in row:
                    raise ValueError("corner 0")
                known = len(points)
                rows.append([corner - 1 if corner > 0 else known + corner for corner in row])
                triangles += len(row) - 2
                if triangles > source.most_triangles:
                    break
        faces = fans_of_rows(rows)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(
            "damaged",
            f"{quote(str(error))}; expected 'v x y z', or 'f' and the numbers of vertices.",
            where=f"line {number}",
        ) from error
    return Solid.from_triangles(
        np.array(points).reshape(-1, 3),
        faces,
        name=source.name or "solid",
        most_triangles=source.most_triangles,
    )
