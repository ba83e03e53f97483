"""Tables: numbers of many lines of text, read without a loop over them, a part at a time."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

CHUNK_BYTES: Final = 4 << 20
SPACE: Final = 32
NEWLINE: Final = 10
LARGEST: Final = 1e15

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """Numbers of lines.

    Attributes:
        values: (N,) float64, one line after the other.
        counts: (L,) how many each line has.
    """

    values: NDArray[np.float64]
    counts: Ints

    @property
    def starts(self) -> Ints:
        """(L,) place of each line's first number."""
        return np.cumsum(self.counts) - self.counts

    def columns(self, first: int, wide: int) -> NDArray[np.float64] | None:
        """(L, wide) numbers of each line from its ``first`` one on; None when a line has fewer."""
        if not len(self.counts):
            return np.zeros((0, wide))
        if self.counts.min() < first + wide:
            return None
        if (self.counts == self.counts[0]).all():
            return self.values.reshape(len(self.counts), -1)[:, first : first + wide]
        return self.values[self.starts[:, None] + np.arange(first, first + wide)]


def whole(values: NDArray[np.float64]) -> Ints | None:
    """The same as whole numbers, None when one is none."""
    if not (np.abs(values) <= LARGEST).all() or (values % 1 != 0).any():
        return None
    return values.astype(np.int64)


def chunks(data: bytes) -> Iterator[bytes]:
    """Whole lines, a few megabytes at a time."""
    at = 0
    while at < len(data):
        end = data.find(b"\n", at + CHUNK_BYTES)
        end = len(data) if end < 0 else end + 1
        yield data[at:end]
        at = end


def table(text: Bytes) -> Table | None:
    """The numbers of lines that hold nothing else; None where they do.

    Args:
        text: Whole lines, the last one ended too.
    """
    if not len(text):
        return Table(values=np.zeros(0), counts=np.zeros(0, dtype=np.int64))
    dark = text > SPACE
    begins = dark.copy()
    begins[1:] &= ~dark[:-1]
    starts = np.concatenate([[0], np.flatnonzero(text[:-1] == NEWLINE) + 1])
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
