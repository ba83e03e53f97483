"""Filled shape: the cells of a shape with the chains of modules that go through them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.feasibility import Feasibility
from foldback.planner.pathfinding.knots import Knot
from foldback.planner.pathfinding.path_reasons import PathReason
from foldback.planner.shapes.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilledShape:
    """Chains through the cells of a shape.

    A point u of the cells' space, in which cell c reaches from c to c + 1 and from which the chains
    were made, lies at ``scale · turn @ u + shift`` in the folded chains' space.

    Attributes:
        chains: Candidates, the best first; empty without one.
        shape: The cells, as they were after repairs; one module each, or several.
        method: Method that found the chains.
        feasibility: Feasibility of the cells; None if it is not in question.
        cells: (n, 3) a cell for each module of the first chain, which names the module; the cells
            of ``shape`` without a chain.
        line: (m, 3) course of the first chain, in steps along the axes of the folded chain's space.
        knot: Knot of the first candidate; None without one.
        notes: Messages for the user.
        reasons: Reasons why there are no chains, or only few.
        repaired: Phrase that says what a repair changed; empty without a repair.
        not_started: Reasons why no chain begins in the requested cell; empty if one does.
        scale, shift: Map to the folded chains' space, see above; ``shift`` is a number or (3,).
        modules_per_cell: Modules for each cell of what was voxelised.
        added: Cells that a repair for a table added, in the frame of ``cells``.
        turn: (3, 3) rotation of the map; of given cells that lie on another side on a table.
    """

    chains: tuple[Chain, ...]
    shape: Shape
    method: str
    feasibility: Feasibility | None
    cells: Ints
    line: Array
    knot: Knot | None
    notes: tuple[str, ...]
    not_started: tuple[PathReason, ...]
    scale: float
    shift: float | Array
    modules_per_cell: int
    reasons: tuple[PathReason, ...] = ()
    repaired: str = ""
    added: tuple[Cell, ...] = ()
    turn: Array = field(default_factory=lambda: np.eye(3))

    def placed(self, points: Array) -> Array:
        """Return (P, 3) points of the cells' space in the folded chains' space."""
        return self.scale * (points @ self.turn.T) + self.shift
