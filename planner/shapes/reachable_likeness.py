"""Reachable likeness: about how many cells it takes to look like a solid to a given degree.

For each of many pitches and shifts of the lattice, the set of cells with the largest overlap (IoU)
is known without a search: the fullest cells. No path through it need exist, but one that is fitted
to the solid comes close to it (decision 0033).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.shapes.inside_points import InsidePoints, inside_points
from foldback.planner.shapes.solid import Solid

LEVELS: Final = (0.6, 0.75, 0.9)
"""Overlaps (IoU, 0 to 1) for which numbers of cells are estimated."""
CELL_POINTS: Final = 32
"""Number of points for each cell by which its filled share is estimated."""
MAX_POINTS: Final = 60_000
"""Maximum number of points; of very many cells each has fewer."""
COUNT_STEPS: Final = (1.15, 1.3)
"""Ratio of two numbers of cells that are tried one after the other: of few, and of many."""
SHIFT_STEP: Final = (0.8192, 0.6710, 0.5497)
"""Difference of two shifts of the lattice that are tried one after the other, in cells: an additive
recurrence that fills the cube evenly (M. Roberts, The unreasonable effectiveness of quasirandom
sequences, 2018)."""
PATH_LOSS: Final = (0.02, 0.5)
"""Overlap (IoU) by which fitted paths fall short of the best cells, and the further overlap of one
cell, which is shared by all: short paths miss more of a solid that branches (decision 0033)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CellUse:
    """Use of cells by modules.

    Attributes:
        min_cells: Smallest number of cells that may be used.
        max_cells: Largest number of cells that may be used.
        in_path: True if the cells are those of a path that is fitted to the solid.
    """

    min_cells: int
    max_cells: int
    in_path: bool = False

    def loss(self, cells: int) -> float:
        """Return the overlap (IoU) by which the use falls short of the best cells."""
        return PATH_LOSS[0] + PATH_LOSS[1] / cells if self.in_path else 0.0


def cells_reaching(solid: Solid, uses: Sequence[CellUse]) -> tuple[dict[float, int | None], ...]:
    """Return, for each use, about how many cells reach each of ``LEVELS``, or None.

    Args:
        solid: The solid, as it shall stand.
        uses: Uses of the cells.
    """
    reached = tuple(dict[float, int | None].fromkeys(LEVELS) for _ in uses)
    count, previous_count = float(min(use.min_cells for use in uses)), 0.0
    inside = InsidePoints(points=np.zeros((0, 3)), volume=0.0)
    while True:
        open_uses = [
            (use, cells)
            for use, cells in zip(uses, reached, strict=True)
            if count <= COUNT_STEPS[0] * use.max_cells and None in cells.values()
        ]
        if not open_uses:
            return reached
        if count > previous_count and len(inside.points) < MAX_POINTS / 2:
            previous_count = 4.0 * count
            inside = inside_points(solid, count=int(min(CELL_POINTS * previous_count, MAX_POINTS)))
        is_large = count > 600
        scaled_points = (inside.points - inside.points.min(axis=0)) / np.cbrt(inside.volume / count)
        # the shift matters less for many cells
        shifts = np.outer(np.arange((8, 3)[is_large]), SHIFT_STEP) % 1.0
        best, iou = max(
            (_best_set(scaled_points + shift, count) for shift in shifts), key=lambda x: x[1]
        )
        for use, cells in open_uses:
            for level, number in cells.items():
                fits = best <= use.max_cells and count >= use.min_cells
                if number is None and fits and iou - use.loss(best) >= level:
                    cells[level] = max(best, use.min_cells)
        count *= COUNT_STEPS[is_large]


def _best_set(points: Array, volume: float) -> tuple[int, float]:
    """Return the size and the overlap (IoU) of the best set of cells with edge 1.

    Args:
        points: (P, 3) points spread evenly in the solid, none negative.
        volume: Volume of the solid.
    """
    sizes = (points.max(axis=0) + 1.0).astype(np.int64)
    x, y, z = points.astype(np.int64).T
    filled = np.bincount((x * sizes[1] + y) * sizes[2] + z)
    filled = np.sort(filled[filled > 0])[::-1] * (volume / len(points))
    shared = np.cumsum(filled)
    ious = shared / (volume + np.arange(1, len(filled) + 1) - shared)
    best = int(ious.argmax())
    return best + 1, float(ious[best])
