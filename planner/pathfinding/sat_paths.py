"""Paths by a SAT solver: circuits through all cells and a dummy node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.pathfinding.circuit_solver import CircuitSolver
from foldback.planner.pathfinding.lattice import colours, neighbours


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverResult:
    """Result of a search for a path by the solver.

    Attributes:
        status: ``infeasible`` is a proof; ``undecided`` means that its time or effort was up.
        order: (n,) indices of the cells in the order of the path, None without one.
    """

    status: Literal["found", "infeasible", "undecided"]
    order: Ints | None = None


def find_path_by_sat(
    cells: Ints,
    rng: np.random.Generator,
    *,
    ends: Flags,
    start: int | None = None,
    effort: float = 4.0,
    time_limit_s: float = 60.0,
) -> SolverResult:
    """Search for a path through cells.

    Args:
        cells: (n, 3) distinct cells.
        rng: Random choice among paths.
        ends: (n,) cells that the path may begin and end with.
        start: Index of the cell that it begins with, None for any.
        effort: The solver's deterministic time, about seconds: the same on every machine.
        time_limit_s: Seconds by the clock, whichever comes first.
    """
    first, last = _end_flags(cells, ends, start)
    arcs: list[tuple[int, int]] = []
    for cell, row in enumerate(neighbours(cells).tolist()):
        arcs += [(cell + 1, neighbour + 1) for neighbour in row if neighbour >= 0]
        if first[cell]:
            arcs.append((0, cell + 1))
        if last[cell]:
            arcs.append((cell + 1, 0))
    solver = CircuitSolver(
        len(cells) + 1,
        arcs,
        seed=int(rng.integers(1 << 30)),
        effort=effort,
        time_limit_s=time_limit_s,
    )
    status, nodes = solver.solve()
    if status != "found":
        return SolverResult(status=status)
    return SolverResult(status="found", order=np.array(nodes[1:], dtype=np.int64) - 1)


def _end_flags(cells: Ints, ends: Flags, start: int | None) -> tuple[Flags, Flags]:
    """Return the (n,) flags of possible first cells, and of possible last cells."""
    black = colours(cells) == 0
    excess = 2 * int(black.sum()) - len(cells)
    if start is not None:
        first = np.zeros(len(cells), dtype=np.bool_)
        first[start] = True
        last = ends & (black == black[start] if excess else black != black[start])
        return first, last
    if excess:
        # One colour more: the path begins and ends with it.
        majority = black if excess > 0 else ~black
        return ends & majority, ends & majority
    # As many of each: it runs from one colour to the other, and back is the same path.
    return ends & black, ends & ~black
