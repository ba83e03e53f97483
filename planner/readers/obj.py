"""OBJ: lines of vertices and polygons; materials, normals and curves are left alone.

trimesh reads them once they are as it expects: no line begins with spaces or ends with a remark,
and corners that count back from their line are counted from the first vertex.
"""

from __future__ import annotations

import re
from typing import Final

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.meshes import load
from planner.shapes.solid import Solid, check_triangles

VERTEX_LINE: Final = re.compile(rb"(?m)^\s*v[ \t]+[-+.\dnNiI]")
LOOKED_AT: Final = 65_536
INDENT: Final = re.compile(rb"(?m)^[ \t]+")
REMARK: Final = re.compile(rb"#[^\n]*")
NUMBER: Final = rb"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\.\d+(?:e[-+]?\d+)?|nan|inf(?:inity)?)"
CORNER: Final = rb"[1-9]\d{0,8}(?:/\S*)?"
WRONG: Final = re.compile(
    rb"(?mi)^(?:v(?=[ \t])(?![ \t]+%s[ \t]+%s[ \t]+%s(?:\s|\Z))"
    rb"|f(?=[ \t])(?!(?:[ \t]+%s){3,}[ \t\r]*$))[^\n]*" % (NUMBER, NUMBER, NUMBER, CORNER)
)
"""A line of a vertex without three numbers, or of a polygon without three vertices."""
BACK: Final = re.compile(rb"(?<=[ \t])-(\d{1,9})")
COUNTED_BACK: Final = re.compile(rb"(?m)^f[ \t][^\n]*[ \t]?-\d")
POLYGON: Final = re.compile(rb"(?m)^f[ \t]")
FLAT: Final = re.compile(rb"(?m)^f(?:[ \t]+\d+(?:/\S*)?){1,2}[ \t\r]*$")
"""A polygon of fewer than three corners, which is left out."""
LARGE: Final = re.compile(rb"(?m)^f(?:[ \t]+\S+){4,}")
"""A polygon of more than three corners."""


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
    if b"#" in data:
        data = REMARK.sub(b"", data)
    if b"\t" in data:
        data = data.replace(b"\t", b" ")
    if INDENT.search(data):
        data = INDENT.sub(b"", data)
    data = FLAT.sub(b"", data)
    if COUNTED_BACK.search(data):
        data = _counted_on(data)
    if (wrong := WRONG.search(data)) is not None:
        line = data.count(b"\n", 0, wrong.start()) + 1
        raise InputError(
            "damaged",
            f"got {quote(wrong[0].decode('latin-1'))!r}, expected 'v x y z', or 'f' and the "
            "numbers of three vertices or more.",
            where=f"line {line}",
        )
    triangles = len(POLYGON.findall(data))
    check_triangles(triangles, source.most_triangles)
    triangles += sum(len(large[0].split()) - 4 for large in LARGE.finditer(data))
    check_triangles(triangles, source.most_triangles)
    return load(data, "obj", source, triangles=triangles)


def _counted_on(data: bytes) -> bytes:
    """The same with corners that count back from the last vertex before them counted on."""
    known = 0

    def counted_on(back: re.Match[bytes]) -> bytes:
        return b"%d" % max(0, known + 1 - int(back[1]))

    lines = data.split(b"\n")
    for i, line in enumerate(lines):
        if line[:2] in (b"v ", b"v\t"):
            known += 1
        elif line[:1] == b"f":
            lines[i] = BACK.sub(counted_on, line)
    return b"\n".join(lines)
