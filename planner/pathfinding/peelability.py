"""Peelability: whether the units of a path can leave one after the other, from its far end on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

UNIT: Final = 32
"""Modules of a unit, as ``PeelingParameters.unit``."""
WAYS: Final = tuple(way for way in product((-1, 0, 1), repeat=3) if any(way))
AXES: Final = tuple(k for k, way in enumerate(WAYS) if sum(map(abs, way)) == 1)
ENOUGH_WAYS: Final = 3
"""Ways out of the core that a unit needs; those with fewer sit in a pit, and stuck."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Peelability:
    """How well a path can be peeled from its far end.

    Attributes:
        unit: Cells that come off at once.
        shares: (U,) for each unit, from the far end on, the largest share of its cells that have a
            free line in one common direction of an axis when it is the unit's turn.
        ways: (U,) of the 26 directions those in which all of its cells have a free line.
    """

    unit: int
    shares: NDArray[np.float64]
    ways: Ints

    @property
    def buried(self) -> Ints:
        """The units of which some cell has no free line in the best direction."""
        return np.flatnonzero(self.shares < 1.0)

    @property
    def free(self) -> bool:
        """Whether every unit can leave along a line."""
        return not len(self.buried)

    @property
    def score(self) -> float:
        """1 when every unit has ways out; less where some have few, by the worst and the mean."""
        ease = self.shares * np.minimum(1.0, self.ways / ENOUGH_WAYS)
        return float(0.5 * (ease.min(initial=1.0) + ease.mean()))


def peelable(cells: Ints, unit: int = UNIT) -> Peelability:
    """Whether a path can be peeled from its far end, and how well.

    Args:
        cells: (n, 3) in the order of the path.
        unit: Cells that come off at once.
    """
    count = len(cells)
    low = cells.min(axis=0) - 1
    grid = np.full(cells.max(axis=0) - low + 2, count, dtype=np.int64)
    places = tuple((cells - low).T)
    grid[places] = np.arange(count)
    # Units are counted from the far end; the last one may be shorter.
    of_unit = (count - 1 - np.arange(count)) // unit
    start = np.maximum(count - unit * (of_unit + 1), 0)
    units = int(of_unit.max()) + 1
    sizes = np.bincount(of_unit, minlength=units)
    shares = np.zeros((len(WAYS), units))
    for k, way in enumerate(WAYS):
        free = _least_beyond(grid, way, count)[places] >= start
        shares[k] = np.bincount(of_unit, weights=free, minlength=units) / sizes
    return Peelability(
        unit=unit,
        shares=shares[list(AXES)].max(axis=0),
        ways=(shares == 1.0).sum(axis=0).astype(np.int64),
    )


def _least_beyond(grid: Ints, way: tuple[int, ...], none: int) -> Ints:
    """The least number on the line from each cell in one direction; the rim of the grid is free."""
    axis = next(k for k in range(3) if way[k])
    found = np.full_like(grid, none)
    source, beyond = np.moveaxis(grid, axis, 0), np.moveaxis(found, axis, 0)
    shift = tuple(-way[k] for k in range(3) if k != axis)
    last = len(source) - 1
    for k in range(last - 1, -1, -1) if way[axis] > 0 else range(1, last + 1):
        next_layer = np.minimum(source[k + way[axis]], beyond[k + way[axis]])
        moved = np.roll(next_layer, shift, axis=(0, 1))
        for side, far in enumerate(shift):  # what came round from the other side is not there
            if far:
                np.moveaxis(moved, side, 0)[0 if far > 0 else -1] = none
        beyond[k] = moved
    return found
