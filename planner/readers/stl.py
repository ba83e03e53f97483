"""STL: triangles one by one, binary or as text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.trimesh_meshes import triangles_in
from planner.shapes.solid import MOST_TRIANGLES, Solid, check_triangles

HEADER_BYTES: Final = 84
TRIANGLE_BYTES: Final = 50
LOOKED_AT: Final = 2048
LONGEST_NAME: Final = 1 << 20
"""Bytes of the first line of a text, at most: longer ones are no name. Chosen."""
LONGEST_TAIL: Final = 4096
ROW: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
LENGTHS: Final = (1e-9, 1e9)
"""What coordinates lie between; of numbers made of random bytes about a quarter does."""
MOST_LENGTHS: Final = 0.6
PART_BYTES: Final = 4 << 20
REST: Final = "bytes after the last triangle were ignored."
FACET_END: Final = b"endfacet"
NAME: Final = re.compile(rb"(?m)^[ \t]*(?:end)?solid\b(?:(?!\bfacet\b).)*")
VERTEX: Final = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
NO_NUMBER: Final = re.compile(
    rb" (?![-+]?(?:[\d.]+(?:e[-+]?\d+)?|nan|inf(?:inity)?)[ \n])([^ \n]*)"
)
SOLID: Final = b"solid\n%bendsolid\n"


def announced(data: bytes) -> int:
    """How many triangles the header of a binary STL announces."""
    return int.from_bytes(data[HEADER_BYTES - 4 : HEADER_BYTES], "little")


def is_stl(data: bytes, hinted: bool) -> bool:
    """Whether this is an STL: its size fits, its words do, or it is binary and called so."""
    return is_binary(data, hinted) or is_text(data)


def is_binary(data: bytes, hinted: bool) -> bool:
    """Whether this is a binary STL; a wrong count is forgiven when the file's name hints at it."""
    if len(data) < HEADER_BYTES:
        return False
    if len(data) == HEADER_BYTES + TRIANGLE_BYTES * announced(data):
        return b"\0" in data[:HEADER_BYTES] or len(data) > HEADER_BYTES
    looks_binary = b"\0" in data[: LOOKED_AT * 4]
    fits = (len(data) - HEADER_BYTES) % TRIANGLE_BYTES == 0 and len(data) > HEADER_BYTES
    if not looks_binary or is_text(data):
        return False
    return _holds_lengths(data) if hinted else fits and data[:5] == b"solid"


def _holds_lengths(data: bytes) -> bool:
    """Whether what follows the header are numbers as shapes have them, not bytes of any kind."""
    count = min((len(data) - HEADER_BYTES) // TRIANGLE_BYTES, LOOKED_AT)
    if not count:
        return announced(data) <= MOST_TRIANGLES
    rows = np.frombuffer(data, dtype=ROW, count=count, offset=HEADER_BYTES)
    sizes = np.abs(rows["corners"].reshape(-1))
    low, high = LENGTHS
    return bool((((sizes > low) & (sizes < high)) | (sizes == 0.0)).mean() > MOST_LENGTHS)


def is_text(data: bytes) -> bool:
    """Whether this is an STL written as text."""
    start = data[:LOOKED_AT].lstrip()
    if start[:5].lower() != b"solid":
        return False
    # The name may be of any length.
    ends = (data.find(mark, 0, LONGEST_NAME) for mark in (b"\n", b"\r"))
    end = min((at for at in ends if at > 0), default=0)
    after = data[end : end + LOOKED_AT] if end > 0 else b""
    return any(word in part.lower() for part in (start, after) for word in (b"facet", b"endsolid"))


def read_stl(data: bytes, source: Source, hinted: bool) -> Solid:
    """A solid from an STL of either kind.

    Raises:
        InputError: For lying and truncated files, and for meshes that are no solid.
    """
    if is_binary(data, hinted):
        return _binary(data, source)
    return _text(data, source)


def _binary(data: bytes, source: Source) -> Solid:
    count = announced(data)
    expected = HEADER_BYTES + TRIANGLE_BYTES * count
    if count or len(data) < HEADER_BYTES + TRIANGLE_BYTES:
        check_triangles(count, source.most_triangles)
    if len(data) < expected:
        held = (len(data) - HEADER_BYTES) // TRIANGLE_BYTES
        raise InputError(
            "truncated",
            f"the header announces {count} triangles and the file holds {held}; save or send it "
            "again.",
        )
    if len(data) > expected + (LONGEST_TAIL if count else 0):
        raise InputError(
            "damaged",
            f"the header announces {count} triangles, but {len(data) - expected} bytes follow "
            "them; save the file again.",
        )
    notes = () if len(data) == expected else (REST,)
    points, faces = triangles_in(data[:expected], "stl")
    return Solid.from_triangles(
        points,
        faces,
        name=source.name or "solid",
        notes=notes,
        most_triangles=source.most_triangles,
    )


def _text(data: bytes, source: Source) -> Solid:
    text = data.lower()
    check_triangles(text.count(FACET_END), source.most_triangles)
    corners = np.concatenate([_corners(part) for part in _facets(text)])
    end = text.rfind(b"endsolid", -LOOKED_AT)
    if end < 0:
        raise InputError("truncated", "the file ends before 'endsolid'; save or send it again.")
    rest = b" ".join(text[end:].splitlines()[1:]).strip()
    return Solid.from_triangles(
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        name=source.name or "solid",
        notes=(REST,) if rest else (),
        most_triangles=source.most_triangles,
    )


def _facets(text: bytes) -> Iterator[bytes]:
    """Whole facets, some megabytes at a time: trimesh takes seven times the memory of text."""
    at, last = 0, text.rfind(FACET_END)
    while (end := text.find(FACET_END, min(at + PART_BYTES, last))) >= at:
        part, at = text[at : end + len(FACET_END)], end + len(FACET_END)
        # A name may hold any words, and one file several solids.
        yield NAME.sub(b"", part) if b"solid" in part else part
    if VERTEX.search(NAME.sub(b"", text[at:])):
        raise InputError(
            "damaged",
            "the last triangle is incomplete; the file is cut off or damaged, save it again.",
        )


def _corners(part: bytes) -> NDArray[np.float64]:
    """(3 F, 3) the vertices of F facets."""
    expected, found = 3 * part.count(FACET_END), VERTEX.findall(part)
    if len(found) != expected:
        raise InputError(
            "damaged",
            f"got {len(found)} vertices in {expected // 3} triangles, expected three in each; the "
            "file is cut or damaged.",
        )
    # trimesh wants a vertex to have a line, joins the numbers of all, and skips bytes of no text.
    text = b"".join(b"vertex %b %b %b\n" % numbers for numbers in found)
    wrong = NO_NUMBER.search(text)
    if wrong is None:
        points, _ = triangles_in(SOLID % text, "stl")
        return points
    raise InputError(
        "not-a-number",
        f"got {quote(wrong[1].decode('latin-1'))!r}, expected three numbers after each 'vertex'.",
    )
