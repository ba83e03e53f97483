"""STL: triangles one by one, binary or as text."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from planner.errors import InputError
from planner.readers.limits import Source
from planner.readers.meshes import check_plain, load
from planner.shapes.solid import MOST_TRIANGLES, Solid, check_triangles

HEADER_BYTES: Final = 84
TRIANGLE_BYTES: Final = 50
LOOKED_AT: Final = 2048
LONGEST_TAIL: Final = 4096
ROW: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
LENGTHS: Final = (1e-9, 1e9)
"""What coordinates lie between; of numbers made of random bytes about a quarter does."""
MOST_LENGTHS: Final = 0.6
ODD: Final = re.compile(rb"vertex[\t -~]*[^\t-\r -~]")
NAME: Final = re.compile(rb"solid\b[^\n]*?(?=\s+facet\b|\n|\Z)")


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
    start = data[:LOOKED_AT].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    return start.startswith(b"solid") and (b"facet" in start or b"endsolid" in start)


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
    check_triangles(count, source.most_triangles)
    expected = HEADER_BYTES + TRIANGLE_BYTES * count
    if len(data) < expected:
        held = (len(data) - HEADER_BYTES) // TRIANGLE_BYTES
        raise InputError(
            "truncated",
            f"the header announces {count} triangles and the file holds {held}; save or send it "
            "again.",
        )
    if len(data) > expected + LONGEST_TAIL:
        raise InputError(
            "damaged",
            f"the header announces {count} triangles and {len(data) - expected} bytes follow them; "
            "save the file again.",
        )
    notes = () if len(data) == expected else ("bytes after the last triangle were left alone.",)
    return load(data[:expected], "stl", source, triangles=count, notes=notes)


def _text(data: bytes, source: Source) -> Solid:
    words = NAME.sub(b"solid", data.lower())
    check_plain(words, ODD)
    count = words.count(b"endfacet")
    check_triangles(count, source.most_triangles)
    corners = words.count(b"vertex")
    if corners != 3 * count:
        raise InputError(
            "damaged",
            f"got {corners} vertices in {count} triangles, expected three in each; the file is cut "
            "or damaged.",
        )
    if b"endsolid" not in words[-LOOKED_AT:]:
        raise InputError("truncated", "the file ends before 'endsolid'; save or send it again.")
    if data.count(b"\n") < corners:  # a line may hold more than one
        words = words.replace(b"vertex", b"\nvertex").replace(b"endloop", b"\nendloop")
    return load(words, "stl_ascii", source, triangles=count)
