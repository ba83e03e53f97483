"""Rules of a path for a table, and a check for violations.

A path that never goes down visits layer after layer: no cell comes later than one above it, and so
no module has to find its way under one that stands already. The converse holds too, as every link
down puts a cell under an earlier one. So there are two rules to choose from, not three: ``layers``
allows no link down; ``falls`` allows some, where the cell that comes under others can still be
reached from a side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.table_paths.base_sides import MIN_BALANCE_MARGIN_PITCH, prefix_margins

LAYERS: Final = "layers"
FALLS: Final = "falls"
Rule = Literal["layers", "falls"]
FLAT_STEPS: Final = ((1, 0), (-1, 0), (0, 1), (0, -1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A rule that a path breaks.

    Attributes:
        reason: The rule, with the cells that break it.
        at: Index along the path of the first affected cell.
        cells: Affected cells.
    """

    reason: PathReason
    at: int
    cells: tuple[Cell, ...]

    @property
    def code(self) -> PathCode:
        """Code of the reason."""
        return self.reason.code


def rule_violations(cells: ArrayLike, *, rule: Rule = "layers") -> tuple[Fault, ...]:
    """Return the violations of a path in their order along it; empty for a path for a table.

    Args:
        cells: (n, 3) cells in the order of the path, as they lie: the lowest are on the floor.
        rule: ``layers`` for a path that never goes down, ``falls`` for one that may.

    Raises:
        InputError: The cells are no path: ``not-adjacent``, ``repeated-cell``, ``too-few-cells``.
    """
    order = Path.from_cells(cells).cells
    order = order - np.array([0, 0, order[:, 2].min()])
    faults = [*_of_the_start(order), *_downs(order, rule), *_hairpins(order), *_unstable(order)]
    return tuple(sorted(faults, key=lambda fault: (fault.at, fault.code)))


def hairpins(order: Ints) -> list[tuple[int, int]]:
    """Return first and last index of each run of vertical links that is left against its approach.

    Links a run lies between are compared; one at an end of the path is no hairpin.
    """
    links = np.diff(order, axis=0)
    flat = np.flatnonzero(links[:, 2] == 0)
    return [
        (a + 1, b)
        for a, b in zip(flat.tolist(), flat[1:].tolist(), strict=False)
        if b > a + 1 and (links[a] == -links[b]).all()
    ]


def boxed_in(order: Ints) -> list[int]:
    """Return the indices of cells under an earlier one that have no free horizontal line."""
    enclosed: list[int] = []
    for k in range(1, len(order)):
        before = order[:k]
        x, y, z = order[k]
        above = (before[:, 0] == x) & (before[:, 1] == y) & (before[:, 2] > z)
        if above.any():
            level = before[before[:, 2] == z]
            if not any(_line_free(level, order[k], step) for step in FLAT_STEPS):
                enclosed.append(k)
    return enclosed


def _line_free(level: Ints, cell: Ints, step: tuple[int, int]) -> bool:
    offset = level[:, :2] - cell[:2]
    along = offset @ np.array(step)
    across = offset @ np.array((step[1], step[0]))
    return not bool(((along > 0) & (across == 0)).any())


def _of_the_start(order: Ints) -> list[Fault]:
    if order[0, 2] == 0 and order[1, 2] == 0:
        return []
    return [Fault(reason=PathReason.of(PathCode.FIRST_LINK), at=0, cells=_named(order[:2]))]


def _downs(order: Ints, rule: Rule) -> list[Fault]:
    if rule == FALLS:
        return [_fault(PathCode.BOXED_IN, order, k, k) for k in boxed_in(order)]
    downs = np.flatnonzero(np.diff(order[:, 2]) < 0).tolist()
    return [_fault(PathCode.GOES_DOWN, order, k, k + 1) for k in downs]


def _hairpins(order: Ints) -> list[Fault]:
    return [_fault(PathCode.HAIRPIN, order, a, b) for a, b in hairpins(order)]


def _fault(code: PathCode, order: Ints, first: int, last: int) -> Fault:
    """Return the fault of the cells from one index of a path to another one."""
    cells = _named(order[first : last + 1])
    reason = PathReason.of(code, cell=cells[0], other_cell=cells[-1])
    return Fault(reason=reason, at=first, cells=cells)


def _unstable(order: Ints) -> list[Fault]:
    bad = np.flatnonzero(prefix_margins(order) < MIN_BALANCE_MARGIN_PITCH).tolist()
    if not bad:
        return []
    k = bad[0]
    reason = PathReason.of(
        PathCode.NOT_STABLE,
        count=k + 1,
        min_margin=MIN_BALANCE_MARGIN_PITCH,
        further=len(bad) - 1,
    )
    return [Fault(reason=reason, at=k, cells=_named(order[k : k + 1]))]


def _named(cells: Ints) -> tuple[Cell, ...]:
    return tuple((int(x), int(y), int(z)) for x, y, z in cells)
