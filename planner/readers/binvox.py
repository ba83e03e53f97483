"""binvox: a header of text, then runs of empty and filled voxels."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, quote, too_many
from foldback.planner.readers.text import PADDING
from foldback.planner.shapes.shape import Shape

BINVOX_MAGIC: Final = b"#binvox"
MAX_SIDE_CELLS: Final = 4096
"""Maximum number of voxels along one side of a binvox grid; a header that states more counts as
damaged."""
DATA: Final = re.compile(rb"(?m)^data[ \t]*\r?\n")


def is_binvox(data: bytes) -> bool:
    """Return True if the bytes begin with the signature of binvox."""
    return data.startswith(BINVOX_MAGIC)


def read_binvox(data: bytes, source: Source) -> Shape:
    """Return the shape in a binvox file.

    The runs are expanded without a grid, so that a wrong header costs no memory.

    Raises:
        InputError: Header and data disagree.
    """
    end = DATA.search(data[:4096])  # usual headers take 100 bytes
    if end is None:
        raise InputError(
            "truncated", "the file ends before the line 'data'; save or send it again."
        )
    dim = next(
        (w[1:] for line in data[: end.start()].splitlines() if (w := line.split())[:1] == [b"dim"]),
        [],
    )
    if len(dim) != 3 or not all(w.isdigit() and 0 < int(w[:6]) <= MAX_SIDE_CELLS for w in dim):
        size_text = quote(b" ".join(dim).decode("latin-1"))
        raise InputError(
            "damaged",
            f"got the size {size_text!r}, expected three whole numbers up to {MAX_SIDE_CELLS} "
            "after 'dim'.",
            where="header",
        )
    depth, width, height = (int(w) for w in dim)
    expected = depth * width * height
    runs = np.frombuffer(data, dtype=np.uint8, offset=end.end())
    if len(runs) < 2:
        raise _wrong_total(expected, 0)
    values, lengths = runs[: len(runs) // 2 * 2].reshape(-1, 2).T
    ends = np.cumsum(lengths, dtype=np.int64)
    last = int(np.searchsorted(ends, expected))
    if last == len(ends) or ends[last] != expected:
        raise _wrong_total(expected, int(ends[-1]))
    if data[end.end() + 2 * (last + 1) :].strip(PADDING):
        raise InputError(
            "damaged",
            f"the header declares {expected} voxels, but more data follows them; the header is "
            "wrong, or the file is damaged.",
        )
    values, lengths = values[: last + 1], lengths[: last + 1].astype(np.int64)
    if (values > 1).any():
        raise InputError("damaged", f"got a voxel of value {values.max()}, expected 0 or 1.")
    filled = int(lengths[values == 1].sum())
    if filled > source.max_cells:
        raise too_many(filled, source.max_cells)
    starts = (np.cumsum(lengths) - lengths)[values == 1]
    lengths = lengths[values == 1]
    places = np.repeat(starts - (np.cumsum(lengths) - lengths), lengths) + np.arange(filled)
    x, remainder = np.divmod(places, width * height)
    z, y = np.divmod(remainder, height)
    return Shape.from_cells(np.column_stack([x, y, z]), name=source.name or "shape")


def _wrong_total(expected: int, total: int) -> InputError:
    return InputError(
        "truncated" if total < expected else "damaged",
        f"the header declares {expected} voxels, but the file has {total}; the header is wrong, or "
        "the file is cut off.",
    )
