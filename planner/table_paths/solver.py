"""Paths that climb, by constraint programming: for layers where trying does not do, and as proof.

A circuit through a dummy node, as ``planner/pathfinding/circuits.py`` has it, with links that go up
or lie flat, and three links each that may not come together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.pathfinding.lattice import STEPS, neighbours
from planner.table_paths.rules import hairpins

Ints = NDArray[np.int64]

EFFORT: Final = 1.0
"""The solver's deterministic time for one call, about seconds: the same on every machine."""
LEAST: Final = 0.01
"""What a question costs at least."""
UP, DOWN = 4, 5
"""Places of the vertical steps among ``STEPS``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Climbed:
    """What the solver found.

    Attributes:
        status: ``infeasible`` is a proof; ``undecided`` means that its effort was spent.
        order: (n,) indices of the cells in the order of the path, None when there is none.
    """

    status: Literal["found", "infeasible", "undecided"]
    order: Ints | None = None


def climbed(
    cells: Ints,
    *,
    seed: int,
    hairpins_allowed: bool = False,
    downs: bool = False,
    effort: float = EFFORT,
) -> Climbed:
    """Looks for a path from the floor up whose first link is flat.

    Hairpins of several vertical links are ruled out when they turn up, and the solver is asked
    again.

    Args:
        cells: (n, 3) distinct cells, the lowest at z = 0.
        seed: Of the solver.
        hairpins_allowed: Also paths with vertical hairpins.
        downs: Also links down, as few as can be found.
        effort: The solver's deterministic time, for all that it is asked.
    """
    from ortools.sat.python import cp_model  # heavy, and needed here only

    near = neighbours(cells)
    model: Any = cp_model.CpModel()
    link: dict[tuple[int, int], Any] = {}
    for a, row in enumerate(near.tolist()):
        for step, b in enumerate(row):
            if b >= 0 and (downs or step != DOWN):
                link[a, b] = model.new_bool_var("")
    arcs = [(a + 1, b + 1, used) for (a, b), used in link.items()]
    for a, (_, _, z) in enumerate(cells.tolist()):
        last = model.new_bool_var("")
        arcs.append((a + 1, 0, last))
        if z == 0:
            first = model.new_bool_var("")
            arcs.append((0, a + 1, first))
            up = link.get((a, int(near[a, UP])))
            if up is not None:
                model.add_bool_or(first.negated(), up.negated())
    model.add_circuit(arcs)
    if not hairpins_allowed:
        for three in _hairpins(near, link):
            model.add_bool_or([link[pair].negated() for pair in three])
    if downs:
        model.minimize(sum(used for (a, b), used in link.items() if cells[b, 2] < cells[a, 2]))
    solver: Any = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = seed % (1 << 31)
    while effort > 0.0:
        solver.parameters.max_deterministic_time = effort
        status = solver.solve(model)
        effort -= solver.response_proto.deterministic_time + LEAST
        if status == cp_model.INFEASIBLE:
            return Climbed(status="infeasible")
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            break
        order = _order(arcs, solver)
        bad = [] if hairpins_allowed else hairpins(cells[order])
        if not bad:
            return Climbed(status="found", order=order)
        for first, last in bad:
            run = order[first - 1 : last + 2].tolist()
            pairs = zip(run, run[1:], strict=False)
            model.add_bool_or([link[pair].negated() for pair in pairs])
    return Climbed(status="undecided")


def _hairpins(near: Ints, link: dict[tuple[int, int], Any]) -> list[list[tuple[int, int]]]:
    """Of each link up or down with opposite links before and after it the three."""
    found: list[list[tuple[int, int]]] = []
    for a, b in link:
        if b not in (near[a, UP], near[a, DOWN]):
            continue
        for step in range(len(STEPS) - 2):
            # From a neighbour of a against this step, and back along it above or below that one.
            before, after = int(near[a, step]), int(near[b, step])
            three = [(before, a), (a, b), (b, after)]
            if before >= 0 and after >= 0 and all(pair in link for pair in three):
                found.append(three)
    return found


def _order(arcs: list[tuple[int, int, Any]], solver: Any) -> Ints:
    follows = {a: b for a, b, used in arcs if solver.boolean_value(used)}
    order, node = list[int](), follows[0]
    while node:
        order.append(node - 1)
        node = follows[node]
    return np.array(order, dtype=np.int64)
