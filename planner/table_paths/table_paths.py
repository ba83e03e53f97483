"""Paths for a table: the best that are found through a shape, over the sides it can lie on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.chain.path import MIN_CELLS
from planner.errors import InputError
from planner.shapes.shape import Shape
from planner.table_paths.climb import Climb
from planner.table_paths.layer import Work
from planner.table_paths.reasons import (
    FALLING_EFFORT,
    NoPath,
    falling,
    most_telling,
    ruled_out,
    unsolved,
)
from planner.table_paths.resting import Side, images, sides_of
from planner.table_paths.rules import FALLS, LAYERS, Rule
from planner.table_paths.score import WEIGHTS, Parts, parts_of

Ints = NDArray[np.int64]

MOST: Final = 8
WORK: Final = 60_000
"""Steps of the search through layers, for all sides of a shape together."""
LOOKED_AT: Final = 6
"""Paths that are scored in full for each one that is kept."""
ALIKE: Final = 0.9
"""Two paths with more than this share of their links in common count as one, where others are."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TablePath:
    """A path in which a chain can fold on a table.

    Attributes:
        cells: (n, 3) int64, read-only, in the order of the chain; the floor is under z = 0.
        down: The side of the shape that is down: ``-z`` as it was given, ``+x`` and so on.
        turn: (3, 3) the rotation of the shape: cell c of it lies at ``turn @ c + shift``.
        shift: (3,) see ``turn``.
        rule: ``layers``: never goes down; ``falls``: goes down where it has to.
        score: How easily it is expected to fold; the lower, the easier.
        parts: What the score is made of.
    """

    cells: Ints
    down: str
    turn: Ints
    shift: Ints
    rule: Rule
    score: float
    parts: Parts


def table_paths(
    cells: ArrayLike,
    *,
    seed: int = 0,
    most: int = MOST,
    turned: bool = True,
    work: int = WORK,
    weights: Parts = WEIGHTS,
) -> tuple[TablePath, ...]:
    """Looks for paths in which a chain of cubes can fold while it rests on a table.

    They visit layer after layer from the floor up, begin with a flat link, have no vertical
    hairpin, and each of their beginnings stands on the floor by itself. Only where no side of the
    shape allows that, paths that go down are looked for. ``rules.faults_of`` says which of these
    rules a path breaks.

    Args:
        cells: (n, 3) whole numbers: the shape, in any order.
        seed: Of all choices; the same seed gives the same paths.
        most: How many paths at most.
        turned: Also lay the shape on its other sides; else it stands as it is.
        work: Steps of the search.
        weights: How much each part of the score counts.

    Returns:
        At least one path, the most promising first.

    Raises:
        InputError: ``overhang``, ``parts``, ``hairpins-only``, ``not-stable`` or ``no-path`` when
            there is none; and what ``Shape.from_cells`` refuses.
    """
    found, reasons = paths_or_reasons(
        cells, seed=seed, most=most, turned=turned, work=work, weights=weights
    )
    if not found:
        raise InputError(*most_telling(reasons))
    return found


def why_none(
    cells: ArrayLike, *, seed: int = 0, turned: bool = True, work: int = WORK
) -> tuple[NoPath, ...]:
    """Why a shape has no path for a table, for each side that it could lie on; empty if it has one.

    Args:
        cells: As ``table_paths`` takes them, and so are the others.
    """
    found, reasons = paths_or_reasons(cells, seed=seed, most=1, turned=turned, work=work)
    return () if found else reasons


def paths_or_reasons(
    cells: ArrayLike,
    *,
    seed: int = 0,
    most: int = MOST,
    turned: bool = True,
    work: int = WORK,
    weights: Parts = WEIGHTS,
) -> tuple[tuple[TablePath, ...], tuple[NoPath, ...]]:
    """The paths that ``table_paths`` gives, and why sides have none; of no paths, all reasons.

    Args:
        cells: As ``table_paths`` takes them, and so are the others.
    """
    given = Shape.from_cells(cells).cells
    if len(given) < MIN_CELLS:
        raise InputError("too-few-cells", f"got {len(given)} cells, expected at least {MIN_CELLS}.")
    sides = list(sides_of(given, turned=turned))
    reasons = {side.down: reason for side in sides if (reason := ruled_out(side)) is not None}
    left = [side for side in sides if side.down not in reasons]
    found: list[TablePath] = []
    climbs: dict[str, Climb] = {}
    for k, side in enumerate(left):
        climb = climbs[side.down] = Climb(side.cells, np.random.default_rng([seed, k]), weights)
        climb.search(Work(work // len(left)))
        found += _made(climb, side, most, weights)
    if not found:
        for side in left:
            order, reason = unsolved(side, seed)
            if order is not None:
                climbs[side.down].add_path(order.tolist())
                found.append(_path(side, order, LAYERS, weights))
                found += _made(climbs[side.down], side, most, weights)
            if reason is not None:
                reasons[side.down] = reason
    if not found:
        open_sides = [side for side in sides if reasons[side.down].may_fall]
        for side in open_sides:
            order, reason = falling(side, seed, effort=FALLING_EFFORT / len(open_sides))
            if order is not None:
                found.append(_path(side, order, FALLS, weights))
            if reason is not None:
                reasons[side.down] = reason
    return _chosen(found, most), tuple(reasons[side.down] for side in sides if side.down in reasons)


def _made(climb: Climb, side: Side, most: int, weights: Parts) -> list[TablePath]:
    orders = climb.best(LOOKED_AT * most)
    return [_path(side, order, LAYERS, weights) for order in orders]


def _path(side: Side, order: Ints, rule: Rule, weights: Parts) -> TablePath:
    cells = side.cells[order]
    cells.setflags(write=False)
    parts = parts_of(cells)
    return TablePath(
        cells=cells,
        down=side.down,
        turn=side.turn,
        shift=side.shift,
        rule=rule,
        score=parts.times(weights),
        parts=parts,
    )


def _chosen(found: list[TablePath], most: int) -> tuple[TablePath, ...]:
    """The best paths; those that are almost another one, or its mirror image, come last."""
    different = {(path.down, path.cells.tobytes()): path for path in found}.values()
    ranked = sorted(different, key=lambda path: (path.score, path.down, path.cells.tobytes()))
    chosen: list[TablePath] = []
    looks: list[frozenset[tuple[int, ...]]] = []
    alike: list[TablePath] = []
    for path in ranked:
        links = [_links(image) for image in images(path.cells)]
        shared = max((len(a & b) for a in links for b in looks), default=0)
        if shared > ALIKE * (len(path.cells) - 1):
            alike.append(path)
        else:
            chosen.append(path)
            looks.append(links[0])
        if len(chosen) == most:
            break
    return tuple((chosen + alike)[:most])


def _links(cells: Ints) -> frozenset[tuple[int, ...]]:
    return frozenset(map(tuple, np.hstack([cells[:-1], cells[1:]]).tolist()))
