"""Columns: named arrays and a JSON header in one binary message, which browsers decode.

A message is a little-endian uint32 with the length of a JSON header, the header, and the arrays,
each aligned to eight bytes. The header's ``columns`` lists the name, dtype, shape and offset of
each array, relative to the end of the (padded) header; all other entries are the sender's.

Numbers that need not be exact can be packed. A column with a ``step`` holds integer numbers of
steps: zigzag codes of their ``differences``-th differences from row to row, as in plan files
(``planner.motion.angle_encoding``). A ``short`` column holds the upper half of each
single-precision number. The bytes of both are split into planes and deflated to ``size`` bytes.
The joint angles of a fold then take a fifth or less of what compression alone would give. A column
with a ``size`` but neither of these holds its values unchanged, in such planes.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.motion.angle_encoding import DIFFERENCE_ORDER

ALIGNMENT_BYTES: Final = 8
"""Multiple of bytes at which each array in a binary message to the browser starts, so that
JavaScript can use it as a typed array without copying."""
COLUMN_DTYPES: Final = frozenset({"<f8", "<f4", "|u1", "<u2", "<u4", "<i4"})


def encode(
    header: Mapping[str, Any],
    columns: Mapping[str, NDArray[Any]],
    *,
    steps: Mapping[str, float] | None = None,
    short: frozenset[str] = frozenset(),
    planes: frozenset[str] = frozenset(),
) -> bytes:
    """Return one message of a header and named arrays.

    Args:
        header: Plain JSON values.
        columns: The arrays.
        steps: Columns to pack as integer numbers of this step; a column with NaN or values that
            are too large for that is sent in single precision.
        short: Columns to pack with a relative precision of 1 in 256.
        planes: Columns to pack without loss.

    Raises:
        TypeError: If an array has a type that JavaScript lacks.
    """
    described: list[dict[str, Any]] = []
    parts: list[bytes] = []
    at = 0
    for name, values in columns.items():
        encoding: dict[str, Any] = {}
        packed = True
        if steps and name in steps and _countable(values, steps[name]):
            encoding = {"step": steps[name], "differences": DIFFERENCE_ORDER}
            array = np.rint(values.astype(np.float64) / steps[name]).astype("<i4")
            for _ in range(DIFFERENCE_ORDER):
                array = np.diff(array, axis=0, prepend=np.zeros_like(array[:1]))
            array = (array << 1) ^ (array >> 31)  # zigzag codes, as in byte_planes
        elif name in short:
            encoding = {"short": True}
            bits = np.ascontiguousarray(values, "<f4").view("<u4")
            # Round to nearest. NaN is written explicitly, because rounding could change it.
            array = ((bits + 0x8000) >> 16).astype("<u2")
            array[np.isnan(values)] = 0x7FC0
        else:
            array = np.ascontiguousarray(values)
            if steps and name in steps:
                array = array.astype("<f4")
            packed = name in planes
        if array.dtype.str not in COLUMN_DTYPES:
            raise TypeError(
                f"got the dtype {array.dtype.str} for {name}, expected one of {COLUMN_DTYPES}"
            )
        data = array.tobytes()
        if packed:
            apart = np.frombuffer(data, np.uint8).reshape(-1, array.dtype.itemsize).T
            data = zlib.compress(np.ascontiguousarray(apart).tobytes(), 6)
            encoding["size"] = len(data)
        described.append(
            {
                "name": name,
                "dtype": array.dtype.str,
                "shape": list(array.shape),
                "at": at,
                **encoding,
            }
        )
        padding = -len(data) % ALIGNMENT_BYTES
        parts.append(data + bytes(padding))
        at += len(data) + padding
    text = json.dumps({**header, "columns": described}, separators=(",", ":"), allow_nan=False)
    words = text.encode()
    words += b" " * (-(4 + len(words)) % ALIGNMENT_BYTES)
    return b"".join([len(words).to_bytes(4, "little"), words, *parts])


def _countable(values: NDArray[Any], step: float) -> bool:
    """Return True if all values and their differences fit into integer numbers of steps."""
    largest = float(np.abs(values).max(initial=0.0))
    # third differences fit into 32 bits
    return largest < 2**28 * step  # False if a value is NaN
