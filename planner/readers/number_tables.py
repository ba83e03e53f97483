"""Number tables: numbers of many lines of text, read in large chunks without a loop over lines."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints

TEXT_CHUNK_BYTES: Final = 4 << 20
"""Number of bytes of a text with rows of numbers that are parsed at once."""
SPACE_BYTE: Final = 32
"""Code of a space in ASCII; bytes with this or a smaller code separate the words of a text."""
NEWLINE_BYTE: Final = 10
"""Code of a line feed in ASCII, which ends each line of a text that is parsed as bytes."""
MAX_WHOLE_NUMBER: Final = 1e15
"""Maximum magnitude of a float that is converted to an integer, where integers are expected; it is
below 2⁵³, so that float64 holds every integer exactly."""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """Numbers of lines.

    Attributes:
        values: (N,) float64, one line after the other.
        counts: (L,) numbers of each line.
    """

    values: Array
    counts: Ints

    @property
    def starts(self) -> Ints:
        """(L,) indices of the first number of each line."""
        return np.cumsum(self.counts) - self.counts

    def columns(self, first: int, wide: int) -> Array | None:
        """Return (L, wide) numbers of each line from index ``first``; None if a line is shorter."""
        if not len(self.counts):
            return np.zeros((0, wide))
        if self.counts.min() < first + wide:
            return None
        if (self.counts == self.counts[0]).all():
            return self.values.reshape(len(self.counts), -1)[:, first : first + wide]
        return self.values[self.starts[:, None] + np.arange(first, first + wide)]


def whole(values: Array) -> Ints | None:
    """Return the values as integers, None if one is not whole."""
    if not (np.abs(values) <= MAX_WHOLE_NUMBER).all() or (values % 1 != 0).any():
        return None
    return values.astype(np.int64)


def chunks(data: bytes) -> Iterator[bytes]:
    """Yield whole lines, a few megabytes at a time."""
    at = 0
    while at < len(data):
        end = data.find(b"\n", at + TEXT_CHUNK_BYTES)
        end = len(data) if end < 0 else end + 1
        yield data[at:end]
        at = end


def table(text: Bytes) -> Table | None:
    """Parse lines of numbers; None if they hold anything else.

    Args:
        text: Whole lines, the last one with its line feed.
    """
    if not len(text):
        return Table(values=np.zeros(0), counts=np.zeros(0, dtype=np.int64))
    dark = text > SPACE_BYTE
    begins = dark.copy()
    begins[1:] &= ~dark[:-1]
    starts = np.concatenate([[0], np.flatnonzero(text[:-1] == NEWLINE_BYTE) + 1])
    counts = np.add.reduceat(begins, starts, dtype=np.int64)
    try:
        with warnings.catch_warnings():
            # What is no number is a warning there, and ends the reading.
            warnings.simplefilter("error")
            values = np.fromstring(text.tobytes(), dtype=np.float64, sep=" ")
    except (DeprecationWarning, ValueError):
        return None
    if len(values) != int(counts.sum()):
        return None
    return Table(values=values, counts=counts)
