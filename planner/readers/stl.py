"""STL: triangles one by one, binary or as text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import MAX_TRIANGLES, Source, quote
from foldback.planner.readers.trimesh_meshes import triangles_in
from foldback.planner.shapes.solid import Solid, check_triangles

HEADER_BYTES: Final = 84
"""Size of everything before the first triangle of a binary STL file, in bytes: 80 bytes of text and
the number of triangles."""
TRIANGLE_BYTES: Final = 50
"""Size of one triangle of a binary STL file, in bytes: a normal and three corners of single
precision, and two attribute bytes."""
STL_PROBE_BYTES: Final = 2048
"""Number of bytes at the beginning of an STL file, and after its first line, that are searched for
the keywords of a text STL, to tell it from a binary one."""
ROW: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
PART_BYTES: Final = 4 << 20
"""Number of bytes of a text STL that are parsed at once."""
TAIL_IGNORED: Final = "bytes after the last triangle were ignored."
FACET_END: Final = b"endfacet"
SOLID_NAME: Final = re.compile(rb"(?m)^[ \t]*(?:end)?solid\b(?:(?!\bfacet\b).)*")
UNFINISHED: Final = re.compile(rb"\bfacet\b")
VERTEX: Final = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
NO_NUMBER: Final = re.compile(
    rb" (?![-+]?(?:[\d.]+(?:e[-+]?\d+)?|nan|inf(?:inity)?)[ \n])([^ \n]*)"
)
ASCII_SOLID: Final = b"solid\n%bendsolid\n"


def announced(data: bytes) -> int:
    """Return the number of triangles that the header of a binary STL declares."""
    return int.from_bytes(data[HEADER_BYTES - 4 : HEADER_BYTES], "little")


def is_stl(data: bytes, hinted: bool) -> bool:
    """Return True if this is an STL by its size, its words, or its name if it is binary."""
    return is_binary(data, hinted) or is_text(data)


def is_binary(data: bytes, hinted: bool) -> bool:
    """Return True if this is a binary STL; with ``hinted`` the count may be wrong."""
    if len(data) < HEADER_BYTES:
        return False
    if len(data) == HEADER_BYTES + TRIANGLE_BYTES * announced(data):
        return b"\0" in data[:HEADER_BYTES] or len(data) > HEADER_BYTES
    looks_binary = b"\0" in data[: STL_PROBE_BYTES * 4]
    fits = (len(data) - HEADER_BYTES) % TRIANGLE_BYTES == 0 and len(data) > HEADER_BYTES
    if not looks_binary or is_text(data):
        return False
    return _holds_lengths(data) if hinted else fits and data[:5] == b"solid"


def _holds_lengths(data: bytes) -> bool:
    """Return True if plausible coordinates follow the header, not arbitrary bytes."""
    count = min((len(data) - HEADER_BYTES) // TRIANGLE_BYTES, 2048)
    if not count:
        return announced(data) <= MAX_TRIANGLES
    rows = np.frombuffer(data, dtype=ROW, count=count, offset=HEADER_BYTES)
    sizes = np.abs(rows["corners"].reshape(-1))
    low, high = 1e-9, 1e9  # a quarter of random numbers lie between these
    return bool((((sizes > low) & (sizes < high)) | (sizes == 0.0)).mean() > 0.6)


def is_text(data: bytes) -> bool:
    """Return True if this is an STL written as text."""
    start = data[:STL_PROBE_BYTES].lstrip()
    if start[:5].lower() != b"solid":
        return False
    # The name may be of any length.
    ends = (data.find(mark, 0, 1 << 20) for mark in (b"\n", b"\r"))
    end = min((at for at in ends if at > 0), default=0)
    after = data[end : end + STL_PROBE_BYTES] if end > 0 else b""
    return any(word in part.lower() for part in (start, after) for word in (b"facet", b"endsolid"))


def read_stl(data: bytes, source: Source, hinted: bool) -> Solid:
    """Return the solid in a binary or text STL.

    Raises:
        InputError: The file is truncated or its header is wrong, or the mesh is no solid.
    """
    if is_binary(data, hinted):
        return _binary(data, source)
    return _text(data, source)


def _binary(data: bytes, source: Source) -> Solid:
    count = announced(data)
    expected = HEADER_BYTES + TRIANGLE_BYTES * count
    if len(data) < expected:
        fitting_count = (len(data) - HEADER_BYTES) // TRIANGLE_BYTES
        raise InputError(
            "truncated",
            f"the header declares {count} triangles, but the file has {fitting_count}; the header "
            "is wrong, or the file is cut off.",
        )
    if count or len(data) < HEADER_BYTES + TRIANGLE_BYTES:
        check_triangles(count, source.max_triangles)
    if len(data) > expected + (4096 if count else 0):
        raise InputError(
            "damaged",
            f"the header declares {count} triangles, but {len(data) - expected} more bytes follow "
            "them; save the file again.",
        )
    notes = () if len(data) == expected else (TAIL_IGNORED,)
    corners = np.frombuffer(data, dtype=ROW, count=count, offset=HEADER_BYTES)["corners"]
    return Solid.from_triangles(
        corners.reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        name=source.name or "solid",
        notes=notes,
        max_triangles=source.max_triangles,
    )


def _text(data: bytes, source: Source) -> Solid:
    text = data.lower()
    check_triangles(text.count(FACET_END), source.max_triangles)
    corners = np.concatenate([_corners(part) for part in _facets(text)])
    end = text.rfind(b"endsolid", -STL_PROBE_BYTES)
    tail = b" ".join(text[end:].splitlines()[1:]).strip()
    if end < 0 or UNFINISHED.search(tail):
        raise InputError("truncated", "the file ends before 'endsolid'; save or send it again.")
    return Solid.from_triangles(
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        name=source.name or "solid",
        notes=(TAIL_IGNORED,) if tail else (),
        max_triangles=source.max_triangles,
    )


def _facets(text: bytes) -> Iterator[bytes]:
    """Yield whole facets, a few megabytes at a time: trimesh takes 7 times the text's memory."""
    at, last = 0, text.rfind(FACET_END)
    while (end := text.find(FACET_END, min(at + PART_BYTES, last))) >= at:
        part, at = text[at : end + len(FACET_END)], end + len(FACET_END)
        # A name may hold any words, and one file several solids.
        yield SOLID_NAME.sub(b"", part) if b"solid" in part else part
    if VERTEX.search(SOLID_NAME.sub(b"", text[at:])):
        raise InputError(
            "damaged",
            "the last triangle is incomplete; the file is cut off or damaged, so save it again.",
        )


def _corners(part: bytes) -> Array:
    """Return the (3 F, 3) vertices of F facets."""
    expected, vertices = 3 * part.count(FACET_END), VERTEX.findall(part)
    if len(vertices) != expected:
        raise InputError(
            "damaged",
            f"got {len(vertices)} vertices in {expected // 3} triangles, expected three vertices "
            "in each triangle; the file is cut off or damaged, so save it again.",
        )
    # trimesh wants a vertex to have a line, joins the numbers of all, and skips bytes of no text.
    text = b"".join(b"vertex %b %b %b\n" % numbers for numbers in vertices)
    wrong = NO_NUMBER.search(text)
    if wrong is None:
        points, _ = triangles_in(ASCII_SOLID % text, "stl")
        return points
    raise InputError(
        "not-a-number",
        f"got {quote(wrong[1].decode('latin-1'))!r}, expected three numbers after each 'vertex'.",
    )
