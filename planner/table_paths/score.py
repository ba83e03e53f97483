"""Score of a path for a table: its expected difficulty; lower is easier.

The fold is the explosion backwards: the path's last cell is let go first, and the tail leaves along
the floor. All parts are averages along the path, so that paths of different lengths compare. The
score is their sum with the weights below, which wait for being tuned against explosions.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.table_paths.base_sides import prefix_margins
from foldback.planner.table_paths.rules import FLAT_STEPS

FRONT_WINDOW_CELLS: Final = 4
"""Number of consecutive cells of a path over which its horizontal position is averaged, to score
how far the place where the chain folds moves sideways; paths that move it less are preferred."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """Parts of a score, or their weights.

    Attributes:
        fall: Mean height of the cells, in pitches: what comes down from there needs torque.
        downs: Links down for each cell.
        bends: Share of the joints that are not straight.
        enclosed: Share of the cells that, when they are let go, have no horizontal line free of
            earlier cells in their layer: their module passes over the core.
        covered: Share of the cells with an earlier cell above them.
        end: Share of the last four cells that are enclosed: the tail's end should lie at the rim.
        rolls: Cells behind runs of vertical links whose links before and after are at a right
            angle, for each cell of the path. A chain cannot twist: when such a run lies down, all
            that comes after it has to roll over by a quarter turn.
        swing: Quarter turns that the way outwards makes from cell to cell, for each cell.
        front: Mean sideways motion of the middle of four cells from cell to cell, pitches.
        overhang: Distance of cells with nothing under them from one with something under it, in
            pitches, for each cell of the path.
        tipping: 1 less the smallest distance, in pitches, that the centre of mass of a beginning
            of the path that has left the floor keeps from the rim of its floor hull; 0 where it
            keeps more than 1.
    """

    fall: float = 0.0
    downs: float = 0.0
    bends: float = 0.0
    enclosed: float = 0.0
    covered: float = 0.0
    end: float = 0.0
    rolls: float = 0.0
    swing: float = 0.0
    front: float = 0.0
    overhang: float = 0.0
    tipping: float = 0.0

    def times(self, weights: Parts) -> float:
        """Return the sum of the parts by weight."""
        return sum(getattr(self, f.name) * getattr(weights, f.name) for f in fields(self))


WEIGHTS: Final = Parts(
    fall=1.0,
    downs=4.0,
    bends=0.5,
    enclosed=2.0,
    covered=4.0,
    end=0.5,
    rolls=2.0,
    swing=1.0,
    front=0.5,
    overhang=2.0,
    tipping=0.5,
)
"""Weights of the properties by which paths for a table are compared, such as links that lead down
(``downs``); the path with the lowest weighted sum is taken."""


def parts_of(order: Ints) -> Parts:
    """Return the parts of the score of a path.

    Args:
        order: (n, 3) cells in the order of the path, those on the floor at z = 0.
    """
    count = len(order)
    links = np.diff(order, axis=0)
    bends = np.diff(links, axis=0).any(axis=1)
    free, covered = _ways_out(order)
    enclosed = np.asarray(~free.any(axis=1))
    return Parts(
        fall=float(order[:, 2].mean()),
        downs=float((links[:, 2] < 0).sum()) / count,
        bends=float(bends.mean()),
        enclosed=float(enclosed.mean()),
        covered=float(covered.mean()),
        end=float(enclosed[-FRONT_WINDOW_CELLS:].mean()),
        rolls=_rolls(links) / count,
        swing=_swing(free) / count,
        front=_front(order),
        overhang=float(levers(order).sum()) / count,
        tipping=_tipping(order),
    )


def levers(cells: Ints) -> Ints:
    """Return (n,) distances of unsupported cells from a supported one of their layer; else 0.

    Distances are in steps along x and y; the number of cells in a layer with nothing under it.
    """
    occupied = {tuple(cell) for cell in cells.tolist()}
    borne = np.array([z == 0 or (x, y, z - 1) in occupied for x, y, z in cells.tolist()])
    distances = np.zeros(len(cells), dtype=np.int64)
    for k in np.flatnonzero(~borne).tolist():
        level = cells[:, 2] == cells[k, 2]
        bearing = cells[level & borne]
        apart = np.abs(bearing[:, :2] - cells[k, :2]).sum(axis=1)
        distances[k] = apart.min() if len(apart) else level.sum()
    return distances


def _ways_out(order: Ints) -> tuple[Flags, Flags]:
    """Return (n, 4) flags of steps without an earlier cell, (n,) flags of one above."""
    offset = order[:, None] - order[None]  # [earlier, cell] after the mask below
    earlier = np.tri(len(order), k=-1, dtype=np.bool_).T
    level = earlier & (offset[:, :, 2] == 0)
    free = np.empty((len(order), 4), dtype=np.bool_)
    for k, (x, y) in enumerate(FLAT_STEPS):
        along = offset[:, :, 0] * x + offset[:, :, 1] * y
        across = offset[:, :, 0] * y + offset[:, :, 1] * x
        free[:, k] = ~(level & (along > 0) & (across == 0)).any(axis=0)
    same_column = (offset[:, :, :2] == 0).all(axis=2)
    covered = (earlier & same_column & (offset[:, :, 2] > 0)).any(axis=0)
    return free, covered


def _rolls(links: Ints) -> int:
    """Count the cells behind each run of vertical links that is left at a right angle."""
    flat = np.flatnonzero(links[:, 2] == 0)
    before, after = flat[:-1], flat[1:]
    turned = (after > before + 1) & ((links[before] * links[after]).sum(axis=1) == 0)
    return int((len(links) - after[turned]).sum())


def _swing(free: Flags) -> float:
    """Return the fewest quarter turns of the exit direction along the cells."""
    turns = np.array([[0, 2, 1, 1], [2, 0, 1, 1], [1, 1, 0, 2], [1, 1, 2, 0]], dtype=np.float64)
    cost = np.zeros(4)
    for row in free[::-1]:
        cost = (cost[:, None] + turns).min(axis=0)
        if row.any():
            cost = np.where(row, cost, np.inf)
    return float(cost.min())


def _tipping(order: Ints) -> float:
    raised = np.asarray(np.maximum.accumulate(order[:, 2]) > 0)
    min_margin = prefix_margins(order)[raised].min(initial=1.0)
    return max(0.0, 1.0 - float(min_margin))


def _front(order: Ints) -> float:
    unit = min(FRONT_WINDOW_CELLS, len(order) - 1)
    sums = np.cumsum(np.vstack([np.zeros((1, 2)), order[:, :2]]), axis=0)
    middles = (sums[unit:] - sums[:-unit]) / unit
    return float(np.linalg.norm(np.diff(middles, axis=0), axis=1).mean())
