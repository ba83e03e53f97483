"""Removal analysis: free directions of the units of a path, from its far end on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints

DIRECTIONS_26: Final = tuple(way for way in product((-1, 0, 1), repeat=3) if any(way))
"""Vectors from a cube's centre towards its 6 faces, 12 edges and 8 corners, along which the removal
of cells is analysed."""
AXIS_DIRECTIONS: Final = tuple(k for k, way in enumerate(DIRECTIONS_26) if sum(map(abs, way)) == 1)
"""Indices in ``DIRECTIONS_26`` of the six directions along the axes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RemovalAnalysis:
    """Free directions of the units of a path, from the far end on.

    Attributes:
        unit: Number of cells of a unit.
        shares: (U,) largest share of a unit's cells that have a free line along one axis when the
            unit is next; units from the far end on.
        ways: (U,) number of the 26 directions in which all cells of a unit have a free line.
    """

    unit: int
    shares: Array
    ways: Ints

    @property
    def buried(self) -> Ints:
        """Indices of the units with a cell without a free line in the best direction."""
        return np.flatnonzero(self.shares < 1.0)

    @property
    def free(self) -> bool:
        """True if every unit can leave along a line."""
        return not len(self.buried)

    @property
    def score(self) -> float:
        """Mean of the worst and the mean unit, 0…1; 1 if all units have free directions."""
        # with fewer of 26, it lies in a pit and jams
        ease = self.shares * np.minimum(1.0, self.ways / 3)
        return float(0.5 * (ease.min(initial=1.0) + ease.mean()))


# The default is that of ``PeelingParameters.unit``.
def analyse_removal(cells: Ints, unit: int = 32) -> RemovalAnalysis:
    """Analyse the removal of a path's units from its far end.

    Args:
        cells: (n, 3) cells in the order of the path.
        unit: Number of cells of a unit.
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
    shares = np.zeros((len(DIRECTIONS_26), units))
    for k, way in enumerate(DIRECTIONS_26):
        free = _least_beyond(grid, way, count)[places] >= start
        shares[k] = np.bincount(of_unit, weights=free, minlength=units) / sizes
    return RemovalAnalysis(
        unit=unit,
        shares=shares[list(AXIS_DIRECTIONS)].max(axis=0),
        ways=(shares == 1.0).sum(axis=0).astype(np.int64),
    )


def _least_beyond(grid: Ints, way: tuple[int, ...], none: int) -> Ints:
    """Return the least number beyond each cell in one direction; ``none`` at the rim."""
    axis = next(k for k in range(3) if way[k])
    nearest = np.full_like(grid, none)
    source, beyond = np.moveaxis(grid, axis, 0), np.moveaxis(nearest, axis, 0)
    steps = [way[k] for k in range(3) if k != axis]
    cells = tuple(slice(max(-step, 0), -step if step > 0 else None) for step in steps)
    ahead_cells = tuple(slice(max(step, 0), step if step < 0 else None) for step in steps)
    last = len(source) - 1
    for k in range(last - 1, -1, -1) if way[axis] > 0 else range(1, last + 1):
        ahead = k + way[axis]
        np.minimum(source[ahead][ahead_cells], beyond[ahead][ahead_cells], out=beyond[k][cells])
    return nearest
