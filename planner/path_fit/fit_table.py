"""Fit of a path for a table: it rises from the floor, stands at all times, and folds easily.

The solid lies on each of its six sides in turn. Annealing keeps the rules of a rising path but the
balance, by which its results are filtered (``planner.table_paths.rules``). Of those that look
nearly alike, the one is taken that scores best for folding (``planner.table_paths.score``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.arrays import Ints
from planner.kernels.path_annealing import anneal
from planner.path_fit.cloud import cloud
from planner.path_fit.fit import (
    FINE_CLOUD,
    MIN_SHARE,
    PITCH_FACTORS,
    ROUGH_CLOUD,
    FittedPath,
    field_of,
    first_step,
    schedule,
)
from planner.path_fit.placements import Counts, Placement, Turn, best_placements
from planner.shapes.lattice_fits import Ladder
from planner.table_paths.base_sides import SIDE_ROTATIONS
from planner.table_paths.rules import rule_violations
from planner.table_paths.score import WEIGHTS, parts_of

SIDES: Final = tuple(np.array(rows, dtype=np.float64) for rows in SIDE_ROTATIONS.values())
"""Rotations that lay the solid on each of its six sides."""
PLACEMENTS_PER_SIDE: Final = 2
"""Number of placements of the lattice for each side of the solid on the floor."""
RUNS: Final = 4
"""Number of annealings in each placement."""
MOVES_PER_CELL: Final = 600
"""Moves of each annealing, for each cell of the requested number."""
MAX_IOU_LOSS: Final = 0.05
"""Largest difference in IoU to the best path for which an easier one is taken."""
MAX_PATHS: Final = 8
"""Maximum number of paths of a fit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TableFit:
    """Path for a table.

    Attributes:
        fitted: The path in its placement; the last axis points up.
        down: Side of the solid on the floor.
        score: Expected difficulty of the fold; lower is easier.
    """

    fitted: FittedPath
    down: str
    score: float


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
    fits = [
        fit
        for k, (down, placement) in enumerate(_placements(ladder, counts, seed))
        for run in range(RUNS)
        if (fit := _annealed(down, placement, counts, [seed, k, run])) is not None
    ]
    if not fits:
        return ()
    least = max(fit.fitted.iou for fit in fits) - MAX_IOU_LOSS
    ranked = sorted((fit for fit in fits if fit.fitted.iou >= least), key=lambda fit: fit.score)
    first = ranked[0].fitted.placement
    return tuple(fit for fit in ranked if fit.fitted.placement is first)[:MAX_PATHS]


def _placements(ladder: Ladder, counts: Counts, seed: int) -> list[tuple[str, Placement]]:
    rough, fine = (
        cloud(*(ladder.solid, ladder.volume, count), turns=SIDES, largest=ladder.apart, seed=seed)
        for count in (ROUGH_CLOUD, FINE_CLOUD)
    )
    rng = np.random.default_rng(seed)
    pitch = ladder.pitch_for(counts.high)
    pitches = tuple(pitch * factor for factor in PITCH_FACTORS)
    return [
        (down, placement)
        for down, rotation in zip(SIDE_ROTATIONS, SIDES, strict=True)
        for placement in list(
            best_placements(
                (rough, fine),
                counts,
                Turn(rotation=rotation, pitches=pitches, is_upright=True),
                least=0.0,
                rng=rng,
            )
        )[:PLACEMENTS_PER_SIDE]
    ]


def _annealed(down: str, placement: Placement, counts: Counts, seed: list[int]) -> TableFit | None:
    field = field_of(placement, counts)
    number = int(np.random.SeedSequence(seed).generate_state(1)[0])
    moves = schedule(MOVES_PER_CELL * counts.high)
    path, _, _ = anneal(field, moves, first_step(field, rises=True), number, True)
    cells: Ints = placement.cells_of(path)
    if len(cells) < counts.low or rule_violations(cells):
        return None
    fitted = FittedPath(placement=placement, cells=cells, iou=placement.overlap(path))
    return TableFit(fitted=fitted, down=down, score=difficulty_of(cells))


def difficulty_of(cells: Ints) -> float:
    """Return the score of the (n, 3) cells of a path whose lowest ones are on the floor."""
    return parts_of(cells - np.array([0, 0, cells[:, 2].min()])).times(WEIGHTS)
