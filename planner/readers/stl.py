"""STL: triangles one by one, binary or as text."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.readers.tables import SPACE, chunks, line_starts, lines_of, table
from planner.shapes.solid import MOST_TRIANGLES, Solid, check_triangles

HEADER_BYTES: Final = 84
TRIANGLE_BYTES: Final = 50
LOOKED_AT: Final = 2048
LONGEST_TAIL: Final = 4096
LOWER: Final = 32
ROW: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
LENGTHS: Final = (1e-9, 1e9)
"""What coordinates lie between; of numbers made of random bytes about a quarter does."""
MOST_LENGTHS: Final = 0.6
VERTEX: Final = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


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
    rows = np.frombuffer(data, dtype=ROW, count=count, offset=HEADER_BYTES)
    with np.errstate(invalid="ignore"):
        corners = rows["corners"].reshape(-1, 3).astype(np.float64)
    return Solid.from_triangles(
        corners,
        np.arange(3 * count).reshape(-1, 3),
        name=source.name or "solid",
        notes=notes,
        most_triangles=source.most_triangles,
    )


def _text(data: bytes, source: Source) -> Solid:
    count = data.lower().count(b"endfacet")
    check_triangles(count, source.most_triangles)
    corners = _corners(data, 3 * count)
    if b"endsolid" not in data[-LOOKED_AT:].lower():
        raise InputError("truncated", "the file ends before 'endsolid'; save or send it again.")
    return Solid.from_triangles(
        corners,
        np.arange(3 * count).reshape(-1, 3),
        name=source.name or "solid",
        most_triangles=source.most_triangles,
    )


def _corners(data: bytes, expected: int) -> NDArray[np.float64]:
    """(V, 3) what follows the words 'vertex'."""
    found = [_many(chunk) for chunk in chunks(data)]
    whole = [part for part in found if part is not None]
    if len(whole) == len(found) and sum(map(len, whole)) == expected:
        return np.concatenate(whole)
    fields = VERTEX.findall(data)
    if len(fields) != expected:
        raise InputError(
            "damaged",
            f"got {len(fields)} vertices in {expected // 3} triangles, expected three in each; the "
            "file is cut or damaged.",
        )
    try:
        return np.array([[float(x), float(y), float(z)] for x, y, z in fields])
    except ValueError as error:
        raise InputError(
            "not-a-number", f"{quote(str(error))}; expected three numbers after each 'vertex'."
        ) from error


def _many(chunk: bytes) -> NDArray[np.float64] | None:
    """The vertices of whole lines at once; None when one is not alone on its line."""
    text = np.frombuffer(chunk if chunk.endswith(b"\n") else chunk + b"\n", dtype=np.uint8).copy()
    at = np.flatnonzero((text[:-6] == ord("v")) | (text[:-6] == ord("V")))
    for place, letter in enumerate(b"vertex"):
        at = at[(text[at + place] | LOWER) == letter]
    if not len(at):
        return np.zeros((0, 3))
    starts = line_starts(text)
    lines = np.searchsorted(starts, at, side="right") - 1
    wanted = np.zeros(len(starts), dtype=bool)
    wanted[lines] = True
    if int(wanted.sum()) != len(at):
        return None
    text[at[:, None] + np.arange(6)] = SPACE
    found = table(lines_of(text, starts, wanted))
    if found is None or not (found.counts == 3).all():
        return None
    return found.columns(0, 3)
