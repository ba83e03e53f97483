"""Columns: arrays and a few words about them in one binary message, for a browser to take apart.

A message is a little-endian uint32 that tells the length of a JSON header, the header, and the
arrays, each beginning at a multiple of eight bytes. The header's ``columns`` lists name, dtype,
shape and place of each array, counted from the end of the (padded) header; all else in it is the
sender's.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

ALIGNED: Final = 8
DTYPES: Final = frozenset({"<f8", "<f4", "|u1", "<u2", "<u4", "<i4"})


def encode(header: Mapping[str, Any], columns: Mapping[str, NDArray[Any]]) -> bytes:
    """One message of a header and named arrays.

    Raises:
        TypeError: For an array of a type that browsers have no word for.
    """
    described: list[dict[str, Any]] = []
    parts: list[bytes] = []
    at = 0
    for name, values in columns.items():
        array = np.ascontiguousarray(values)
        if array.dtype.str not in DTYPES:
            raise TypeError(f"got the dtype {array.dtype.str} for {name}, expected one of {DTYPES}")
        described.append(
            {"name": name, "dtype": array.dtype.str, "shape": list(array.shape), "at": at}
        )
        data = array.tobytes()
        padding = -len(data) % ALIGNED
        parts.append(data + bytes(padding))
        at += len(data) + padding
    text = json.dumps({**header, "columns": described}, separators=(",", ":"), allow_nan=False)
    words = text.encode()
    words += b" " * (-(4 + len(words)) % ALIGNED)
    return b"".join([len(words).to_bytes(4, "little"), words, *parts])


def decode(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header and the arrays of a message made by ``encode``."""
    length = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + length])
    start = 4 + length
    columns = {
        c["name"]: np.frombuffer(
            message, c["dtype"], int(np.prod(c["shape"])), start + c["at"]
        ).reshape(c["shape"])
        for c in header.pop("columns")
    }
    return header, columns
