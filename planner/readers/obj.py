"""OBJ: lines of vertices and polygons; materials and normals are left alone."""

from __future__ import annotations

import re
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, check_lines, parse_float, parse_int
from foldback.planner.readers.text import data_start, numbered_lines, without_comments
from foldback.planner.readers.trimesh_meshes import triangles_in
from foldback.planner.shapes.polygons import skipped_note
from foldback.planner.shapes.solid import Solid, check_triangles

VERTEX_LINE: Final = re.compile(rb"(?m)^[ \t]*v[ \t]+[-+.\dnNiI]")
NEWLINE: Final = b"\n"
LINE_BREAK: Final = b"\\\n"
CONTINUED: Final = re.compile(
    rb"(?m)^[ \t]*[vf][ \t](?:[^\\\n]|\\(?!\n))*+(?:\\\n(?:[^\\\n]|\\(?!\n))*+)++"
)
"""Matches a vertex or polygon that goes on in further lines. Other statements are ignored, and may
end with the backslash of a path."""
BLANKS: Final = bytes.maketrans(b"\t\f\v", b"   ")
FREE_FORM: Final = re.compile(rb"(?m)^[ \t]*(surf|curv2?|call|csh|fo|bzp|bsp|cdc|cdp|res)[ \t]")
POINTS_OR_LINES: Final = re.compile(rb"(?m)^[ \t]*[pl][ \t]+[-\d]")
OTHER_LINES: Final = re.compile(rb"(?m)^(?:(?! *[vf] ).*\n)++")
SPARE_SPACE: Final = re.compile(rb"(?m)^ +| +$| +(?= )")
BEYOND: Final = re.compile(rb"(\nv(?: [^ \n]+){3}) .*")
NO_VERTEX: Final = re.compile(rb"\nv(?!(?: [-+.0-9a-zA-Z]+){3}\n)")
NO_POLYGON: Final = re.compile(rb"\nf(?!(?: \+?0*[1-9][0-9]*){3,}\n)")
SHORT_POLYGON: Final = re.compile(rb"\nf(?: \+?0*[1-9][0-9]*){1,2}(?=\n)")
TEXTURE: Final = re.compile(rb"/[^ \n]*")
COUNTED_BACK: Final = re.compile(rb"\nf[^-\n]*-")


def is_obj(data: bytes) -> bool:
    """Return True if a line near the beginning is an OBJ vertex."""
    data_begin = data_start(data)
    start = data[data_begin : data_begin + 65_536]
    return start.lstrip()[:1] not in (b"{", b"[") and VERTEX_LINE.search(start) is not None


def read_obj(data: bytes, source: Source) -> Solid:
    """Return the solid in an OBJ file. Files that it refers to are not opened.

    Raises:
        InputError: A line cannot be read, or the mesh is no solid.
    """
    check_lines(data, source.max_triangles)
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    free_form = FREE_FORM.search(data)
    if free_form is not None:
        raise InputError(
            "unsupported",
            f"the statement {free_form[1].decode()!r} is not supported; export the model as "
            "polygons.",
            where=f"line {data.count(NEWLINE, 0, free_form.start(1)) + 1}",
        )
    lines = POINTS_OR_LINES.search(data) is not None
    text = BEYOND.sub(rb"\1", _plain(data))
    polygons, vertices = text.count(b"\nf "), text.count(b"\nv ")
    # A line of three coordinates has three spaces, one of n corners n.
    triangles = text.count(b" ") - 3 * vertices - 2 * polygons
    if polygons == 0:
        contents = "points and lines" if lines else "points"
        raise InputError(
            "no-triangles", f"got an OBJ file with only {contents}, expected polygons."
        )
    check_triangles(max(triangles, min(polygons, 1)), source.max_triangles)
    try:
        # trimesh skips bytes of no text, joins the numbers of all lines, leaves out polygons of
        # fewer than three words and takes corner 0 for the first vertex.
        if NO_VERTEX.search(text):
            raise _damaged("a vertex without three coordinates")
        text = TEXTURE.sub(b"", text) if b"/" in text else text
        text = _counted_from_the_first(text) if COUNTED_BACK.search(text) else text
        text, skipped = SHORT_POLYGON.subn(b"", text)
        if NO_POLYGON.search(text):
            raise _damaged("a polygon with unknown vertices")
        # An empty mesh is refused without a search for a damaged line.
        points, faces = triangles_in(text, "obj") if skipped < polygons else ([], [])
    except InputError as refusal:
        raise (_first_fault(data, vertices) or refusal) from refusal
    if skipped == polygons:
        raise InputError(
            "no-triangles",
            "got an OBJ file whose polygons all have fewer than three corners, expected a closed "
            "surface of polygons.",
        )
    return Solid.from_triangles(
        points,
        faces,
        name=source.name or "solid",
        notes=(*(("points and lines were ignored.",) if lines else ()), *skipped_note(skipped)),
        max_triangles=source.max_triangles,
    )


def _damaged(problem: str, line: int | None = None) -> InputError:
    return InputError(
        "damaged",
        f"got {problem}, expected 'v x y z' for a vertex, or 'f' and vertex numbers for a polygon.",
        where=None if line is None else f"line {line}",
    )


def _plain(data: bytes) -> bytes:
    """Return the lines of vertices and polygons, with single spaces; each begins with a newline.

    trimesh knows no tabs and indents, and cuts a mesh apart where its material changes.
    """
    text = _continued(data)
    text = b"\n%b" % OTHER_LINES.sub(b"", b"%b\n" % text.translate(BLANKS))
    text = without_comments(text)
    spare = any(pattern in text for pattern in (b"  ", b"\n ", b" \n"))
    return SPARE_SPACE.sub(b"", text) if spare else text


def _continued(data: bytes) -> bytes:
    """Return a file with continued lines joined, and as many empty lines after them."""
    if LINE_BREAK not in data:
        return data
    return CONTINUED.sub(
        lambda match: match[0].replace(LINE_BREAK, b" ") + NEWLINE * match[0].count(LINE_BREAK),
        data,
    )


def _counted_from_the_first(text: bytes) -> bytes:
    """Return the lines with negative vertex numbers replaced by positive ones.

    Negative numbers count back from the last vertex before the line; trimesh counts from the
    last vertex of the file.
    """
    vertex_count = 0
    lines: list[bytes] = []
    for line in text.split(b"\n"):
        vertex_count += line[:1] == b"v"
        if line[:1] == b"f" and b"-" in line:
            try:
                corners = [parse_int(word) for word in line.split()[1:]]
            except ValueError as error:
                raise _damaged(str(error)) from error
            # One before the first vertex becomes 0.
            counted = [max(0, vertex_count + 1 + at) if at < 0 else at for at in corners]
            line = b"f " + b" ".join(b"%d" % at for at in counted)
        lines.append(line)
    return b"\n".join(lines)


def _first_fault(data: bytes, vertices: int) -> InputError | None:
    """Return the error of the first line that cannot be read; None if all can."""
    vertex_count = 0
    text = without_comments(_continued(data)).decode("latin-1")
    for number, line in numbered_lines(text):
        kind, *words = line.split() or [""]
        try:
            if kind == "v":
                vertex_count += 1
                if len([parse_float(word) for word in words[:3]]) < 3:
                    raise ValueError(f"a vertex with {len(words)} coordinates")
            elif kind == "f":
                for corner in (parse_int(word.partition("/")[0]) for word in words):
                    if corner == 0:
                        raise ValueError("the vertex number 0 (OBJ counts from 1)")
                    if not -vertex_count <= corner <= vertices:
                        return InputError(
                            "bad-index",
                            f"got vertex {corner}, but the file has {vertices} vertices; every "
                            "corner of a polygon must be a vertex of the file.",
                            where=f"line {number}",
                        )
        except ValueError as error:
            return _damaged(str(error), number)
    return None
