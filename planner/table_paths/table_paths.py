"""Paths for a table: the best paths through a shape over the sides on which it can lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import MIN_CELLS
from foldback.planner.errors import InputError
from foldback.planner.shapes.shape import Shape
from foldback.planner.table_paths.base_sides import Side, images, sides_of
from foldback.planner.table_paths.layer import Work
from foldback.planner.table_paths.layer_path_search import Climb
from foldback.planner.table_paths.no_table_path_proofs import (
    FALLING_EFFORT,
    NoPath,
    falling,
    ruled_out,
    unsolved,
)
from foldback.planner.table_paths.rules import FALLS, LAYERS, Rule
from foldback.planner.table_paths.score import WEIGHTS, Parts, parts_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TablePath:
    """A path in which a chain can fold on a table.

    Attributes:
        cells: (n, 3) int64, read-only, in the order of the chain; the floor is under z = 0.
        down: Side of the shape that is down: ``-z`` as given, ``+x`` and so on.
        turn: (3, 3) the rotation of the shape: cell c of it lies at ``turn @ c + shift``.
        shift: (3,) shift after the rotation, see ``turn``.
        rule: ``layers``: never goes down; ``falls``: goes down if it has to.
        score: Expected difficulty of the fold; lower is easier.
        parts: Parts of the score.
    """

    cells: Ints
    down: str
    turn: Ints
    shift: Ints
    rule: Rule
    score: float
    parts: Parts


def paths_or_reasons(
    cells: ArrayLike,
    *,
    seed: int = 0,
    max_paths: int = 8,
    turned: bool = True,
    work: int = 60_000,
    weights: Parts = WEIGHTS,
) -> tuple[tuple[TablePath, ...], tuple[NoPath, ...]]:
    """Search for paths in which a chain of cubes can fold while it rests on a table.

    They visit layer after layer from the floor up, begin with a flat link, have no vertical
    hairpin, and each of their beginnings stands on the floor by itself. Only where no side of the
    shape allows that, descending paths are searched. ``rules.rule_violations`` reports which of
    these rules a path breaks.

    Args:
        cells: (n, 3) whole numbers: the shape, in any order.
        seed: Seed of all random choices.
        max_paths: Maximum number of paths.
        turned: True to try all sides of the shape, False to keep it as it stands.
        work: Steps of the search.
        weights: Weight of each part of the score.

    Returns:
        Paths, the most promising first, and the reasons of sides without a path.

    Raises:
        InputError: ``too-few-cells``, and what ``Shape.from_cells`` refuses.
    """
    unique_cells = Shape.from_cells(cells).cells
    if len(unique_cells) < MIN_CELLS:
        raise InputError(
            "too-few-cells", f"got {len(unique_cells)} cells, expected at least {MIN_CELLS}."
        )
    sides = list(sides_of(unique_cells, turned=turned))
    reasons = {side.down: reason for side in sides if (reason := ruled_out(side)) is not None}
    candidates = [side for side in sides if side.down not in reasons]
    paths: list[TablePath] = []
    climbs: dict[str, Climb] = {}
    for k, side in enumerate(candidates):
        climb = climbs[side.down] = Climb(side.cells, np.random.default_rng([seed, k]), weights)
        climb.search(Work(work // len(candidates)))
        paths += _best_paths(climb, side, max_paths, weights)
    if not paths:
        for side in candidates:
            order, reason = unsolved(side, seed)
            if order is not None:
                climbs[side.down].add_path(order.tolist())
                paths.append(_path(side, order, LAYERS, weights))
                paths += _best_paths(climbs[side.down], side, max_paths, weights)
            if reason is not None:
                reasons[side.down] = reason
    if not paths:
        open_sides = [side for side in sides if reasons[side.down].may_fall]
        for side in open_sides:
            order, reason = falling(side, seed, effort=FALLING_EFFORT / len(open_sides))
            if order is not None:
                paths.append(_path(side, order, FALLS, weights))
            if reason is not None:
                reasons[side.down] = reason
    return _chosen(paths, max_paths), tuple(
        reasons[side.down] for side in sides if side.down in reasons
    )


def _best_paths(climb: Climb, side: Side, max_paths: int, weights: Parts) -> list[TablePath]:
    orders = climb.best(6 * max_paths)
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


def _chosen(paths: list[TablePath], max_paths: int) -> tuple[TablePath, ...]:
    """Return the best paths; those almost equal to another or its mirror image come last."""
    different = {(path.down, path.cells.tobytes()): path for path in paths}.values()
    ranked = sorted(different, key=lambda path: (path.score, path.down, path.cells.tobytes()))
    picked: list[TablePath] = []
    looks: list[frozenset[tuple[int, ...]]] = []
    alike: list[TablePath] = []
    for path in ranked:
        links = [_links(image) for image in images(path.cells)]
        shared = max((len(a & b) for a in links for b in looks), default=0)
        if shared > 0.9 * (len(path.cells) - 1):
            alike.append(path)
        else:
            picked.append(path)
            looks.append(links[0])
        if len(picked) == max_paths:
            break
    return tuple((picked + alike)[:max_paths])


def _links(cells: Ints) -> frozenset[tuple[int, ...]]:
    return frozenset(map(tuple, np.hstack([cells[:-1], cells[1:]]).tolist()))
