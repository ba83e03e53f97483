"""Fit of a path for a table: it rises from the floor, stands at all times, and folds easily.

The solid lies on each of its six sides in turn. Annealing keeps the rules of a rising path but the
balance, by which its results are filtered (``planner.table_paths.rules``). In some annealings high
cells cost something, because modules that come down from there need torque. The path is taken with
the best sum of its likeness and its score for folding (``planner.table_paths.score``).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.core import FULL, anneal
from foldback.planner.core.structures import Field
from foldback.planner.path_fit.cloud import clouds_of
from foldback.planner.path_fit.fit import (
    MIN_SHARE,
    PITCH_FACTORS,
    FittedPath,
    field_of,
    first_step,
    schedule,
)
from foldback.planner.path_fit.placements import MARGIN, Counts, Placement, Turn, best_placements
from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES
from foldback.planner.shapes.lattice_fits import Ladder
from foldback.planner.table_paths.base_sides import SIDE_ROTATIONS
from foldback.planner.table_paths.rules import rule_violations
from foldback.planner.table_paths.score import WEIGHTS, parts_of

SIDES: Final = tuple(np.array(rows, dtype=np.float64) for rows in SIDE_ROTATIONS.values())
"""Rotations that lay the solid on each of its six sides."""
HEIGHT_COSTS: Final = (0.0, 0.05, 0.05, 0.05, 0.1, 0.1)
"""Cost of a cell for each layer between it and the lowest one, in cells; one annealing in each
placement for each of them (decision 0038)."""
FEW_COSTS: Final = HEIGHT_COSTS[:2]
"""The same for more than ``MAX_TABLE_MODULES`` modules: a walk along the path checks each accepted
move, so the processor time grows with the square of their number."""
MAX_TABLE_FITTED_MODULES: Final = 200
"""Maximum number of modules of a path that is fitted for a table: about 5 s of processor time."""
MOVES_PER_CELL: Final = 600
"""Moves of each annealing, for each cell of the requested number."""
MIN_IOU_SHARE: Final = 0.8
"""Smallest IoU of a path that is taken, relative to the best one: an easier fold of something that
no longer looks like the solid is of no use."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TableFit:
    """Path for a table.

    Attributes:
        fitted: The path in its placement; the last axis points up.
        down: Side of the solid on the floor.
        cost: Expected difficulty of the fold, and what the path lacks in likeness; see ``cost_of``.
    """

    fitted: FittedPath
    down: str
    cost: float


def fit_on_table(ladder: Ladder, modules: int, *, seed: int = 0) -> tuple[TableFit, ...]:
    """Fit paths for a table to a solid; all of them in one placement, the easiest first.

    Args:
        ladder: The solid.
        modules: Largest number of cells.
        seed: Random seed.

    Returns:
        The paths; empty if no path that was found keeps the rules.
    """
    counts = Counts(low=int(np.ceil(MIN_SHARE * modules)), high=modules)
    costs = HEIGHT_COSTS if modules <= MAX_TABLE_MODULES else FEW_COSTS
    fits = [
        fit
        for k, (down, placement) in enumerate(_placements(ladder, counts, seed))
        for run, height_cost in enumerate(costs)
        if (fit := _annealed(down, placement, counts, height_cost, [seed, k, run])) is not None
    ]
    min_iou = MIN_IOU_SHARE * max((fit.fitted.iou for fit in fits), default=0.0)
    ranked = sorted((fit for fit in fits if fit.fitted.iou >= min_iou), key=lambda fit: fit.cost)
    return tuple(fit for fit in ranked if fit.fitted.placement is ranked[0].fitted.placement)[:8]


def _placements(ladder: Ladder, counts: Counts, seed: int) -> list[tuple[str, Placement]]:
    clouds = clouds_of(ladder, seeds=(seed, seed))
    rng = np.random.default_rng(seed)
    pitch = ladder.pitch_for(counts.high)
    pitches = tuple(pitch * factor for factor in PITCH_FACTORS)
    placements: list[tuple[str, Placement]] = []
    for down, rotation in zip(SIDE_ROTATIONS, SIDES, strict=True):
        turn = Turn(rotation=rotation, pitches=pitches, is_upright=True)
        turn_placements = best_placements(clouds, counts, turn, min_bound=0.0, rng=rng)
        best = sorted(islice(turn_placements, 4), key=lambda placement: -placement.bound)
        placements += [(down, placement) for placement in best[:2]]
    return placements


def _annealed(
    down: str, placement: Placement, counts: Counts, height_cost: float, seed: list[int]
) -> TableFit | None:
    field = _field(placement, counts, height_cost)
    number = int(np.random.SeedSequence(seed).generate_state(1)[0])
    moves = schedule(MOVES_PER_CELL * counts.high)
    path, _, _ = anneal(field, moves, first_step(field, rises=True), number, True)
    cells: Ints = placement.cells_of(path)
    if len(cells) < counts.low or rule_violations(cells):
        return None
    fitted = FittedPath.along(placement, path)
    return TableFit(fitted=fitted, down=down, cost=cost_of(cells, fitted.iou))


def _field(placement: Placement, counts: Counts, height_cost: float) -> Field:
    """Return the cells of a placement, with a cost for those above the solid's lowest layer."""
    field = field_of(placement, counts)
    heights = np.maximum(np.arange(placement.fill.shape[2]) - MARGIN - 1, 0)
    costs = np.broadcast_to(heights * round(height_cost * FULL), placement.fill.shape)
    return field._replace(cost=costs.reshape(-1).astype(np.int64))


def cost_of(cells: Ints, iou: float) -> float:
    """Return the expected difficulty of a fold on a table, plus what its cells lack in likeness.

    Args:
        cells: (n, 3) cells in the order of the path, the lowest ones on the floor.
        iou: Intersection over union with the solid.
    """
    standing = cells - np.array([0, 0, cells[:, 2].min()])
    # 0.05 of IoU are worth a difficulty of 1: docs/decisions/0038
    return parts_of(standing).times(WEIGHTS) + 20.0 * (1.0 - iou)
