"""Rows of numbers: many lines of text, read in large chunks without a loop over lines."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NumberRows:
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
    if not (np.abs(values) <= 1e15).all() or (values % 1 != 0).any():  # below 2⁵³
        return None
    return values.astype(np.int64)


def chunks(data: bytes) -> Iterator[bytes]:
    """Yield whole lines, a few megabytes at a time."""
    at = 0
    while at < len(data):
        end = data.find(b"\n", at + (4 << 20))
        end = len(data) if end < 0 else end + 1
        yield data[at:end]
        at = end


def parse_rows(text: Bytes) -> NumberRows | None:
    """Parse lines of numbers; None if they hold anything else.

    Args:
        text: Whole lines, the last one with its line feed.
    """
    if not len(text):
        return NumberRows(values=np.zeros(0), counts=np.zeros(0, dtype=np.int64))
    dark = text > ord(" ")
    begins = dark.copy()
    begins[1:] &= ~dark[:-1]
    starts = np.concatenate([[0], np.flatnonzero(text[:-1] == ord("\n")) + 1])
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
    return NumberRows(values=values, counts=counts)
