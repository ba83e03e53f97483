"""Ascending paths by a SAT solver: a search for hard layers, and proofs that there is none.

A circuit through a dummy node, as in ``planner/pathfinding/sat_paths.py``, with links that go
up or lie flat, and forbidden triples of links.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import STEPS
from foldback.planner.pathfinding.circuit_solver import CircuitSolver
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.pathfinding.sat_paths import SolverResult
from foldback.planner.table_paths.rules import hairpins

UP, DOWN = 4, 5
"""Places of the vertical steps among ``STEPS``."""


def find_ascending_path(
    cells: Ints,
    *,
    seed: int,
    hairpins_allowed: bool = False,
    downs: bool = False,
    effort: float = 1.0,
) -> SolverResult:
    """Search for a path from the floor up whose first link is flat.

    Hairpins of several vertical links are ruled out when they turn up, and the solver is asked
    again.

    Args:
        cells: (n, 3) distinct cells, the lowest at z = 0.
        seed: Seed of the solver.
        hairpins_allowed: True to allow vertical hairpins.
        downs: True to allow links down, as few as can be found.
        effort: Deterministic effort of all calls of the solver together, about seconds.
    """
    near = neighbours(cells)
    links = {
        (a, b)
        for a, row in enumerate(near.tolist())
        for step, b in enumerate(row)
        if b >= 0 and (downs or step != DOWN)
    }
    floor = np.flatnonzero(cells[:, 2] == 0).tolist()
    arcs = [(a + 1, b + 1) for a, b in sorted(links)]
    arcs += [(0, a + 1) for a in floor] + [(a + 1, 0) for a in range(len(cells))]
    solver = CircuitSolver(len(cells) + 1, arcs, seed=seed, effort=effort)
    for a in floor:
        if (a, above := int(near[a, UP])) in links:
            solver.forbid([(0, a + 1), (a + 1, above + 1)])
    if not hairpins_allowed:
        for three in _hairpins(near, links):
            solver.forbid((a + 1, b + 1) for a, b in three)
    best: Ints | None = None
    while True:
        status, nodes = solver.solve()
        if status != "found":
            break
        order = np.array(nodes[1:], dtype=np.int64) - 1
        bad = [] if hairpins_allowed else hairpins(cells[order])
        for start, end in bad:
            solver.forbid(pairwise(nodes[start : end + 3]))
        if bad:
            continue
        best = order
        count = int((np.diff(cells[order, 2]) < 0).sum())
        if not count:
            break
        falling = [arc for arc in arcs if min(arc) and cells[arc[1] - 1, 2] < cells[arc[0] - 1, 2]]
        solver.allow_at_most(count - 1, falling)
    if best is None:
        return SolverResult(status=status)
    return SolverResult(status="found", order=best)


def _hairpins(near: Ints, link: set[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Return the triples of a vertical link and opposite links before and after it."""
    triples: list[list[tuple[int, int]]] = []
    for a, b in sorted(link):
        if b not in (near[a, UP], near[a, DOWN]):
            continue
        for step in range(len(STEPS) - 2):
            # From a neighbour of a against this step, and back along it above or below that one.
            before, after = int(near[a, step]), int(near[b, step])
            three = [(before, a), (a, b), (b, after)]
            if before >= 0 and after >= 0 and all(pair in link for pair in three):
                triples.append(three)
    return triples
