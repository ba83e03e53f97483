"""CDR: messages of ROS 2 as bytes (OMG CDR 1.0, little endian, as DDS and MCAP carry them)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HEAD: Final = b"\x00\x01\x00\x00"
"""Says little endian; alignment counts from behind it."""
SECOND_NS: Final = 1_000_000_000


class Cdr:
    """A message while it is written, field by field in the order of its definition."""

    def __init__(self, begun: bytes = HEAD) -> None:
        self._data = bytearray(begun)

    def __bytes__(self) -> bytes:
        return bytes(self._data)

    def time(self, time_ns: int) -> Cdr:
        """A ``builtin_interfaces`` Time or Duration."""
        self._align(4)
        self._data += struct.pack("<iI", *divmod(time_ns, SECOND_NS))
        return self

    def count(self, number: int) -> Cdr:
        """The length of a sequence, whose elements follow."""
        self._align(4)
        self._data += struct.pack("<I", number)
        return self

    def string(self, text: str) -> Cdr:
        """A string."""
        data = text.encode() + b"\x00"
        self.count(len(data))
        self._data += data
        return self

    def strings(self, texts: Sequence[str]) -> Cdr:
        """A sequence of strings."""
        self.count(len(texts))
        for text in texts:
            self.string(text)
        return self

    def doubles(self, values: Array) -> Cdr:
        """As many ``float64`` as there are, without their number."""
        if values.size:
            self._align(8)
            self._data += values.astype("<f8").tobytes()
        return self

    def _align(self, size: int) -> None:
        self._data += bytes(-(len(self._data) - len(HEAD)) % size)
