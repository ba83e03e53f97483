"""No-path proofs: proofs and reasons that a shape has no path for a table on a side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.lattice import parts
from foldback.planner.pathfinding.no_path_proofs import obstacles, tuples
from foldback.planner.table_paths.ascending_sat_paths import find_ascending_path
from foldback.planner.table_paths.base_sides import (
    MIN_BALANCE_MARGIN_PITCH,
    SIDE_NAMES,
    Side,
    stands,
)
from foldback.planner.table_paths.rules import FALLS, rule_violations

Code = Literal["overhang", "parts", "hairpins-only", "not-stable", "no-path"]

FALLING_EFFORT: Final = 1.5
"""Solver budget, in deterministic time units of about one second, for table paths that may go down,
tried if no path was found that never goes down; shared among the shape's orientations on the
table."""
NO_TABLE_PATH_REMEDY: Final = (
    "Add cells, fold only a part of the shape, or fold the whole shape in zero gravity."
)
SHORT_REASONS: Final[dict[Code, str]] = {
    "hairpins-only": "every path turns back directly above itself",
    "no-path": "the shape has no path",
    "not-stable": "the shape would tip over or almost tip over",
    "overhang": "separate parts are joined only by cells with nothing below",
    "parts": "a layer has several parts",
}
"""Reasons by their codes, as clauses, for all sides but the one that comes closest to a path."""
LAY: Final = "Lay the shape on another side, or give it a wider foot."


@dataclass(frozen=True, slots=True, kw_only=True)
class NoPath:
    """Reason why a shape has no path on one side.

    Attributes:
        down: Side that is down, see ``TablePath.down``.
        code: ``overhang``: cells that nothing bears join what stands apart; ``parts``: a layer
            falls into parts, which a path that never goes down cannot all visit;
            ``hairpins-only``: all paths turn back above themselves; ``not-stable``: it tips over;
            ``no-path``.
        detail: One sentence: the observation and the need of a chain.
        remedy: Advice.
        cells: Affected cells, as the shape lies on that side.
        may_fall: True if a descending path may still exist.
        cause: Code of the ``Problem`` behind ``no-path``, empty without one.
    """

    down: str
    code: Code
    detail: str
    remedy: str = NO_TABLE_PATH_REMEDY
    cells: tuple[Cell, ...] = ()
    may_fall: bool = False
    cause: str = ""

    @property
    def text(self) -> str:
        """Text of side, detail and remedy."""
        return f"with its {SIDE_NAMES[self.down]} side down: {self.detail} {self.remedy}"


def ruled_out(side: Side) -> NoPath | None:
    """Return a proof in linear time that a side has no path, or None."""
    cells = side.cells
    problems = obstacles(cells)
    if problems:
        problem = problems[0]
        reason = _no_path(side, "no-path", problem.detail, problem.cells)
        return replace(reason, cause=problem.code)
    floor = cells[cells[:, 2] == 0]
    if len(floor) == 1:
        detail = "only one cell touches the floor, but the first two modules must lie on the floor."
        return _no_path(side, "no-path", detail, tuples(floor), remedy=LAY)
    margin = stands(cells)
    if margin < MIN_BALANCE_MARGIN_PITCH:
        return _tipping(side, margin, "the shape", floor)
    for height in range(int(cells[:, 2].max()) + 1):
        layer = cells[cells[:, 2] == height]
        reason = _of_layer(side, layer, height)
        if reason is not None:
            return reason
        margin = stands(cells[cells[:, 2] <= height])
        if margin < MIN_BALANCE_MARGIN_PITCH:
            return _tipping(side, margin, _lowest_layers(height + 1), layer)
    return None


def unsolved(side: Side, seed: int) -> tuple[Ints | None, NoPath | None]:
    """Search a side's path with the solver: indices of its cells, or a reason."""
    search = find_ascending_path(side.cells, seed=seed)
    if search.order is not None:
        faults = rule_violations(side.cells[search.order])
        if not faults:
            return search.order, None
        detail = f"the search found a path, but the chain cannot follow it: {faults[0].detail}"
        return None, _no_path(side, "not-stable", detail, faults[0].cells)
    if search.status == "undecided":
        detail = (
            "the search found no path that starts on the floor and never goes down, but such a "
            "path may exist."
        )
        return None, _no_path(side, "no-path", detail, may_fall=True)
    free = find_ascending_path(side.cells, seed=seed, hairpins_allowed=True)
    if free.status == "found":
        return None, _hairpins_only(side, "every path that starts on the floor and never goes down")
    found_none = "proved that there is no" if free.status == "infeasible" else "found no"
    detail = f"the search {found_none} path that starts on the floor and never goes down."
    return None, _no_path(side, "no-path", detail, may_fall=True)


def falling(side: Side, seed: int, *, effort: float) -> tuple[Ints | None, NoPath | None]:
    """Search for a path with few descents that keeps all other rules.

    Args:
        side: Side to search.
        seed: Seed of the solver.
        effort: Deterministic effort of the solver, about seconds.

    Returns:
        The path as indices of the side's cells, and a reason if more is known now.
    """
    result = find_ascending_path(side.cells, seed=seed, downs=True, effort=effort)
    if result.order is not None:
        if not rule_violations(side.cells[result.order], rule=FALLS):
            return result.order, None
    elif result.status == "infeasible":
        free = find_ascending_path(
            side.cells, seed=seed, downs=True, hairpins_allowed=True, effort=effort
        )
        if free.status == "found":
            return None, _hairpins_only(
                side, "every path that starts flat on the floor, even if it goes down in between,"
            )
    return None, None


def closest(reasons: tuple[NoPath, ...]) -> NoPath:
    """Return the reason of the side that comes closest to a path."""
    ranks = {"hairpins-only": 0, "not-stable": 2}
    return min(reasons, key=lambda reason: ranks.get(reason.code, 1))


def most_telling(reasons: tuple[NoPath, ...]) -> tuple[str, str]:
    """Return code and detail without any path: of the closest side, and codes of the rest."""
    first = closest(reasons)
    other_sides = [
        f" With its {SIDE_NAMES[reason.down]} side down, {SHORT_REASONS[reason.code]}."
        for reason in reasons
        if reason is not first
    ]
    others_text = "".join(other_sides)
    prefix = "got a shape that cannot fold on a table, because it has no suitable path"
    return first.code, f"{prefix}; {first.text}{others_text}"


def _of_layer(side: Side, layer: Ints, height: int) -> NoPath | None:
    count, _ = parts(layer)
    if count == 1:
        problems = obstacles(layer) if len(layer) > 2 else ()
        if not problems:
            return None
        detail = f"layer {height + 1} from the bottom: {problems[0].detail}"
        reason = _no_path(side, "no-path", detail, problems[0].cells, may_fall=True)
        return replace(reason, cause=problems[0].code)
    cells = side.cells
    joined, _ = parts(cells[cells[:, 2] <= height])
    if joined > 1:
        hanging = _borne_by_nothing(cells)
        detail = (
            f"{len(hanging)} cell{'s' * (len(hanging) != 1)} with nothing below "
            f"connect{'s' * (len(hanging) == 1)} {joined} separate parts; a chain that never "
            "goes down cannot fold such a shape."
        )
        return _no_path(side, "overhang", detail, tuples(hanging), may_fall=True)
    detail = (
        f"layer {height + 1} from the bottom consists of {count} separate parts; a chain that "
        "never goes down cannot leave a layer and come back."
    )
    return _no_path(side, "parts", detail, tuples(layer), may_fall=True)


def _hairpins_only(side: Side, subject: str) -> NoPath:
    detail = (
        f"{subject} turns back directly above itself at some point. On a table, a chain "
        "cannot make such a turn."
    )
    return _no_path(side, "hairpins-only", detail, may_fall=True)


def _borne_by_nothing(cells: Ints) -> Ints:
    """Return the (k, 3) cells above the floor without a cell under them."""
    occupied = {tuple(cell) for cell in cells.tolist()}
    hanging = [z > 0 and (x, y, z - 1) not in occupied for x, y, z in cells.tolist()]
    return cells[np.array(hanging, dtype=np.bool_)]


def _lowest_layers(count: int) -> str:
    layers = "layer" if count == 1 else f"{count} layers"
    return f"a chain folds the lowest {layers} first, and this part"


def _tipping(side: Side, margin: float, subject: str, cells: Ints) -> NoPath:
    detail = (
        f"{subject} would tip over: its centre of mass is {-margin:.2g} module widths "
        "outside its base."
        if margin < 0
        else f"{subject} would almost tip over: its centre of mass is {margin:.2g} module widths "
        f"inside the edge of its base, but at least {MIN_BALANCE_MARGIN_PITCH:g} module widths are "
        "needed."
    )
    return _no_path(side, "not-stable", detail, tuples(cells), remedy=LAY)


def _no_path(
    side: Side,
    code: Code,
    detail: str,
    cells: tuple[Cell, ...] = (),
    *,
    may_fall: bool = False,
    remedy: str = NO_TABLE_PATH_REMEDY,
) -> NoPath:
    return NoPath(
        down=side.down, code=code, detail=detail, remedy=remedy, cells=cells, may_fall=may_fall
    )
