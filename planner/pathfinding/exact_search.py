"""Exact path search: tests that prove there is no path, a fast search, then a solver."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.core import ease, grow
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.lattice import colours, index_of, neighbours, surface
from foldback.planner.pathfinding.no_path_proofs import obstacles
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pathfinding.sat_paths import find_path_by_sat
from foldback.planner.shapes.shape import Shape

MOVES_PER_CELL: Final = 20
"""Minimum number of backbite moves (a random change of a path's end) of one attempt at a path, per
cell of the shape."""
FAST_ATTEMPTS: Final = 6
"""Number of random attempts at a path (backbite moves) before each call of the exact solver."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactSearch:
    """Result of a search for a path.

    Attributes:
        status: ``infeasible`` is proved; ``undecided`` means that the time was up.
        cells: (n, 3) the cells in order, None when no path was found.
        reasons: Reasons why no path was found; empty if one was.
    """

    status: Literal["found", "infeasible", "undecided"]
    cells: Ints | None
    reasons: tuple[PathReason, ...] = ()


def exact_path(
    shape: Shape,
    *,
    time_limit_s: float = 20.0,
    seed: int = 0,
    start: Cell | None = None,
    ends_on_surface: bool = False,
    eased: bool = True,
) -> ExactSearch:
    """Search for a path that visits every cell of a shape once.

    Args:
        shape: The shape.
        time_limit_s: Wall-clock limit, s.
        seed: Seed of all random choices.
        start: The cell that the path begins with, None for any.
        ends_on_surface: True if both ends must have a free face.
        eased: True to bring touching cells closer along the path, so that it unfolds more easily.

    Raises:
        InputError: ``not-a-cell``: the start is none of the shape's cells.
    """
    deadline = time.monotonic() + time_limit_s
    cells = shape.cells
    first = index_of(cells, start)
    problems = obstacles(cells)
    if problems:
        reasons = tuple(problem.reason for problem in problems)
        return ExactSearch(status="infeasible", cells=None, reasons=reasons)
    ends = surface(cells) if ends_on_surface else np.ones(len(cells), dtype=np.bool_)
    refused = _refused_ends(cells, ends, first)
    if refused:
        reasons = (PathReason.of(refused),)
        return ExactSearch(status="infeasible", cells=None, reasons=reasons)
    search = _Search(cells, ends, first, np.random.default_rng(seed))
    status, order = search.run(deadline)
    if order is None:
        reason = PathReason.of(PathCode.NO_PATH_WITH_ENDS)
        if status == "undecided":
            reason = PathReason.of(PathCode.UNDECIDED, limit_s=time_limit_s)
        return ExactSearch(status=status, cells=None, reasons=(reason,))
    if eased and len(cells) <= 600:  # every move visits all cells
        order = search.eased(order)
    return ExactSearch(status="found", cells=cells[order])


def _refused_ends(cells: Ints, ends: Flags, start: int | None) -> PathCode | None:
    """Return the reason why colours rule out such ends, or None."""
    shades = colours(cells)
    excess = len(cells) - 2 * int(shades.sum())
    shade = 0 if excess > 0 else 1
    if start is not None and not ends[start]:
        return PathCode.START_INSIDE
    if start is not None and excess and shades[start] != shade:
        return PathCode.START_COLOUR
    if excess and int((ends & (shades == shade)).sum()) < 2:
        return PathCode.ENDS_COLOUR
    return None


class _Search:
    """Fast attempts and the solver by turns, until one of them is done or the time is up."""

    def __init__(
        self, cells: Ints, ends: Flags, start: int | None, rng: np.random.Generator
    ) -> None:
        self.cells, self.ends, self.start, self.rng = cells, ends, start, rng
        self.near = neighbours(cells)
        self.min_moves = MOVES_PER_CELL * len(cells)
        self.moves = max(self.min_moves, 40_000_000 // len(cells))  # 0.25 s of processor time

    def run(
        self, deadline: float
    ) -> tuple[Literal["found", "infeasible", "undecided"], Ints | None]:
        effort = 2.0
        while True:
            for attempt in range(FAST_ATTEMPTS):
                # A short attempt first: most shapes need no more.
                short = attempt < FAST_ATTEMPTS // 2
                order = self.grown(max(self.min_moves, self.moves // 20) if short else self.moves)
                if order is not None:
                    return "found", order
                if time.monotonic() > deadline:
                    return "undecided", None
            remaining_s = deadline - time.monotonic()
            result = find_path_by_sat(
                self.cells,
                self.rng,
                ends=self.ends,
                start=self.start,
                effort=effort,
                time_limit_s=max(0.1, remaining_s),
            )
            if result.status != "undecided":
                return result.status, result.order
            effort *= 2.0

    def grown(self, moves: int) -> Ints | None:
        start = -1 if self.start is None else self.start
        count, order = grow(self.near, self.ends, start, moves, int(self.rng.integers(1 << 30)))
        return order if count == len(self.cells) else None

    def eased(self, order: Ints) -> Ints:
        start = -1 if self.start is None else self.start
        seed = int(self.rng.integers(1 << 30))
        return ease(order, self.near, self.ends, start, 200_000, seed)
