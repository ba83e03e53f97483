"""Joining: separate parts of a drawing in cells, joined by short straight or bent bridges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Flags, Ints
from foldback.planner.shapes.bridges import parts_of

MAX_PARTS: Final = 24
"""Maximum number of parts of a drawing that are joined; one with more is refused."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joined:
    """A drawing in one part.

    Attributes:
        cells: (rows, columns) True for its cells.
        parts: Number of parts before joining.
        added: Number of cells of the bridges.
    """

    cells: Flags
    parts: int
    added: int


def joined(cells: Flags) -> Joined:
    """Join the parts of a drawing, always the two that are nearest to each other.

    Args:
        cells: (rows, columns) True for the cells, at least one.
    """
    cells = cells.copy()
    numbers, sizes = parts_of(cells)
    before = int(cells.sum())
    while numbers.max() > 1:
        start, end = _nearest(numbers)
        _bridge(cells, start, end)
        numbers, _ = parts_of(cells)
    return Joined(cells=cells, parts=len(sizes), added=int(cells.sum()) - before)


def _nearest(numbers: NDArray[np.int32]) -> tuple[Ints, Ints]:
    """Return the two cells of different parts with the fewest cells between them.

    Of equal ones that is taken whose bridge runs straight, then the lowest one.
    """
    places = np.argwhere(numbers > 0)
    part = numbers[places[:, 0], places[:, 1]]
    best: tuple[tuple[int, int, int], int, int] | None = None
    for first in range(1, int(part.max())):
        ours, others = np.flatnonzero(part == first), np.flatnonzero(part > first)
        steps = np.abs(places[ours][:, None, :] - places[others][None, :, :])
        lengths = steps.sum(axis=2)
        bent = (steps.min(axis=2) > 0).astype(np.int64)
        rows = -np.minimum(places[ours][:, None, 0], places[others][None, :, 0])
        cost = (lengths * 2 + bent) * 100_000 + rows
        k = int(np.argmin(cost))
        i, j = divmod(k, len(others))
        key = (int(lengths[i, j]), int(bent[i, j]), int(rows[i, j]))
        if best is None or key < best[0]:
            best = key, int(ours[i]), int(others[j])
    assert best is not None
    return places[best[1]], places[best[2]]


def _bridge(cells: Flags, start: Ints, end: Ints) -> None:
    """Fill the cells from one to another one: along the column first, then along the row."""
    (row, column), (last_row, last_column) = start.tolist(), end.tolist()
    low, high = sorted((row, last_row))
    cells[low : high + 1, column] = True
    low, high = sorted((column, last_column))
    cells[last_row, low : high + 1] = True
