"""Paths by constraint programming: OR-tools' CP-SAT with a circuit through a dummy node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from planner.pathfinding.lattice import colours, neighbours

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """What the solver found.

    Attributes:
        status: ``infeasible`` is a proof; ``undecided`` means that its time was up.
        order: (n,) indices of the cells in the order of the path, None when there is none.
    """

    status: Literal["found", "infeasible", "undecided"]
    order: Ints | None = None


def circuit(
    cells: Ints,
    rng: np.random.Generator,
    *,
    ends: Flags,
    start: int | None = None,
    effort: float = 4.0,
    time_limit_s: float = 60.0,
    taste: bool = True,
) -> Circuit:
    """Looks for a path through cells.

    Args:
        cells: (n, 3) distinct cells.
        rng: Which of the paths is liked, and the solver's seed.
        ends: (n,) cells that the path may begin and end with.
        start: Index of the cell that it begins with, None for any.
        effort: The solver's deterministic time, about seconds: the same on every machine.
        time_limit_s: Seconds by the clock, whichever comes first.
        taste: Look for a path that random weights like rather than for any path.
    """
    from ortools.sat.python import cp_model  # heavy, and needed here only

    model: Any = cp_model.CpModel()
    arcs: list[tuple[int, int, Any]] = []
    tastes: list[Any] = []
    # A path that is liked one way need not be liked the other way: with a taste both are left.
    first, last = (ends, ends) if taste and start is None else _end_flags(cells, ends, start)
    for cell, row in enumerate(neighbours(cells).tolist()):
        for other in row:
            if other >= 0:
                arcs.append((cell + 1, other + 1, model.new_bool_var("")))
                tastes.append(int(rng.integers(0, 100)) * arcs[-1][2])
        if first[cell]:
            arcs.append((0, cell + 1, model.new_bool_var("")))
        if last[cell]:
            arcs.append((cell + 1, 0, model.new_bool_var("")))
    model.add_circuit(arcs)
    if taste:
        model.minimize(sum(tastes))
    solver: Any = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = int(rng.integers(1 << 30))
    solver.parameters.max_deterministic_time = effort
    solver.parameters.max_time_in_seconds = time_limit_s
    status = solver.solve(model)
    if status == cp_model.INFEASIBLE:
        return Circuit(status="infeasible")
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return Circuit(status="undecided")
    follows = {a: b for a, b, used in arcs if solver.boolean_value(used)}
    order, node = list[int](), follows[0]
    while node:
        order.append(node - 1)
        node = follows[node]
    return Circuit(status="found", order=np.array(order, dtype=np.int64))


def _end_flags(cells: Ints, ends: Flags, start: int | None) -> tuple[Flags, Flags]:
    """Which cells a path may begin with, and which ones it may end with."""
    black = colours(cells) == 0
    excess = 2 * int(black.sum()) - len(cells)
    if start is not None:
        first = np.zeros(len(cells), dtype=np.bool_)
        first[start] = True
        last = ends & (black == black[start] if excess else black != black[start])
        return first, last
    if excess:
        # One colour more: the path begins and ends with it.
        more = black if excess > 0 else ~black
        return ends & more, ends & more
    # As many of each: it runs from one colour to the other, and back is the same path.
    return ends & black, ends & ~black
