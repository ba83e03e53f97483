"""Filled: cells filled with the modules of chains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.pathfinding import Cell
from planner.pathfinding.feasibility import Feasibility
from planner.pathfinding.knots import Knot
from planner.shapes.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filled:
    """What became of a shape's cells.

    A point u of the cells' space, in which cell c reaches from c to c + 1 and from which the chains
    were made, lies at ``scale · u + shift`` in the folded chains' space.

    Attributes:
        chains: Candidates, best first; empty when there is none.
        shape: The cells, as they were after repairs; one module each, or several.
        method: How the chains were found.
        feasibility: Whether the cells have a path at all; None where that is no question.
        cells: (n, 3) for each module of the first chain a cell by which it can be named; those of
            ``shape`` without a chain.
        line: (m, 3) the first chain's course, each step along an axis, in the folded chain's space.
        knot: Of the first candidate; None without one.
        notes: What people should know, in plain words.
        not_started: Why no chain begins where it was wished for, or empty.
        scale, shift: See above; ``shift`` is one number, or (3,).
        modules_per_cell: Modules for each cell of what was voxelised.
        added: Cells that a repair for a table added, as ``cells`` has them.
    """

    chains: tuple[Chain, ...]
    shape: Shape
    method: str
    feasibility: Feasibility | None
    cells: NDArray[np.int64]
    line: NDArray[np.float64]
    knot: Knot | None
    notes: tuple[str, ...]
    not_started: str
    scale: float
    shift: float | NDArray[np.float64]
    modules_per_cell: int
    added: tuple[Cell, ...] = ()
