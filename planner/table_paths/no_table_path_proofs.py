"""No-path proofs: proofs and reasons that a shape has no path for a table on a side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.lattice import parts
from foldback.planner.pathfinding.no_path_proofs import obstacles, tuples
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
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
        reason: The observation and the need of a chain.
        remedy: Advice.
        cells: Affected cells, as the shape lies on that side.
        may_fall: True if a descending path may still exist.
    """

    down: str
    code: Code
    reason: PathReason
    remedy: str = NO_TABLE_PATH_REMEDY
    cells: tuple[Cell, ...] = ()
    may_fall: bool = False

    @property
    def text(self) -> str:
        """Text of side, reason and remedy."""
        return f"with its {SIDE_NAMES[self.down]} side down: {self.reason.text} {self.remedy}"


def ruled_out(side: Side) -> NoPath | None:
    """Return a proof in linear time that a side has no path, or None."""
    cells = side.cells
    problems = obstacles(cells)
    if problems:
        return _no_path(side, "no-path", problems[0].reason, problems[0].cells)
    floor = cells[cells[:, 2] == 0]
    if len(floor) == 1:
        reason = PathReason.of(PathCode.ONE_FLOOR_CELL)
        return _no_path(side, "no-path", reason, tuples(floor), remedy=LAY)
    margin = stands(cells)
    if margin < MIN_BALANCE_MARGIN_PITCH:
        return _tipping(side, margin, floor)
    for height in range(int(cells[:, 2].max()) + 1):
        layer = cells[cells[:, 2] == height]
        no_path = _of_layer(side, layer, height)
        if no_path is not None:
            return no_path
        margin = stands(cells[cells[:, 2] <= height])
        if margin < MIN_BALANCE_MARGIN_PITCH:
            return _tipping(side, margin, layer, layers=height + 1)
    return None


def unsolved(side: Side, seed: int) -> tuple[Ints | None, NoPath | None]:
    """Search a side's path with the solver: indices of its cells, or a reason."""
    search = find_ascending_path(side.cells, seed=seed)
    if search.order is not None:
        faults = rule_violations(side.cells[search.order])
        if not faults:
            return search.order, None
        reason = faults[0].reason.with_values(found=True)
        return None, _no_path(side, "not-stable", reason, faults[0].cells)
    if search.status == "undecided":
        reason = PathReason.of(PathCode.UNDECIDED_ON_TABLE)
        return None, _no_path(side, "no-path", reason, may_fall=True)
    free = find_ascending_path(side.cells, seed=seed, hairpins_allowed=True)
    if free.status == "found":
        return None, _hairpins_only(side, falls=False)
    reason = PathReason.of(PathCode.NO_ASCENDING_PATH, proved=free.status == "infeasible")
    return None, _no_path(side, "no-path", reason, may_fall=True)


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
            return None, _hairpins_only(side, falls=True)
    return None, None


def closest(reasons: tuple[NoPath, ...]) -> NoPath:
    """Return the reason of the side that comes closest to a path."""
    ranks = {"hairpins-only": 0, "not-stable": 2}
    return min(reasons, key=lambda reason: ranks.get(reason.code, 1))


def no_path_error(reasons: tuple[NoPath, ...], advice: str = "") -> InputError:
    """Return the error of a shape without any path, in the words of the side that comes closest.

    Args:
        reasons: Reason of each side.
        advice: Text after the reasons.
    """
    first = closest(reasons)
    other_sides = [
        f" With its {SIDE_NAMES[reason.down]} side down, {SHORT_REASONS[reason.code]}."
        for reason in reasons
        if reason is not first
    ]
    prefix = "got a shape that cannot fold on a table, because it has no suitable path"
    return InputError(
        first.code,
        f"{prefix}; {first.text}{''.join(other_sides)}{advice}",
        reasons=[{"down": reason.down, **reason.reason.as_dict()} for reason in reasons],
    )


def _of_layer(side: Side, layer: Ints, height: int) -> NoPath | None:
    count, _ = parts(layer)
    if count == 1:
        problems = obstacles(layer) if len(layer) > 2 else ()
        if not problems:
            return None
        reason = problems[0].reason.with_values(layer=height + 1)
        return _no_path(side, "no-path", reason, problems[0].cells, may_fall=True)
    cells = side.cells
    joined, _ = parts(cells[cells[:, 2] <= height])
    if joined > 1:
        hanging = _borne_by_nothing(cells)
        reason = PathReason.of(PathCode.OVERHANG, count=len(hanging), parts=joined)
        return _no_path(side, "overhang", reason, tuples(hanging), may_fall=True)
    reason = PathReason.of(PathCode.PARTS, layer=height + 1, parts=count)
    return _no_path(side, "parts", reason, tuples(layer), may_fall=True)


def _hairpins_only(side: Side, *, falls: bool) -> NoPath:
    reason = PathReason.of(PathCode.HAIRPINS_ONLY, falls=falls)
    return _no_path(side, "hairpins-only", reason, may_fall=True)


def _borne_by_nothing(cells: Ints) -> Ints:
    """Return the (k, 3) cells above the floor without a cell under them."""
    occupied = {tuple(cell) for cell in cells.tolist()}
    hanging = [z > 0 and (x, y, z - 1) not in occupied for x, y, z in cells.tolist()]
    return cells[np.array(hanging, dtype=np.bool_)]


def _tipping(side: Side, margin: float, cells: Ints, **layers: int) -> NoPath:
    reason = PathReason.of(PathCode.TIPS_OVER, margin=margin, **layers)
    if margin >= 0.0:
        reason = PathReason.of(
            PathCode.ALMOST_TIPS_OVER,
            margin=margin,
            min_margin=MIN_BALANCE_MARGIN_PITCH,
            **layers,
        )
    return _no_path(side, "not-stable", reason, tuples(cells), remedy=LAY)


def _no_path(
    side: Side,
    code: Code,
    reason: PathReason,
    cells: tuple[Cell, ...] = (),
    *,
    may_fall: bool = False,
    remedy: str = NO_TABLE_PATH_REMEDY,
) -> NoPath:
    return NoPath(
        down=side.down, code=code, reason=reason, remedy=remedy, cells=cells, may_fall=may_fall
    )
