"""Fit: a path whose cells look like a solid, found by annealing paths in a few placements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.core import (
    BACKBITE,
    CORNER,
    CUT,
    DETOUR,
    GROW,
    PARALLEL,
    RETRACT,
    SLITHER,
    anneal,
)
from foldback.planner.core.structures import Field, Schedule
from foldback.planner.path_fit.cloud import clouds_of
from foldback.planner.path_fit.placements import (
    CUBES,
    Counts,
    Lattice,
    Placement,
    Turn,
    best_placements,
)
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import spread
from foldback.planner.shapes.lattice_fits import Ladder
from foldback.planner.shapes.tunnels import tunnels_of_cells

MIN_SHARE: Final = 0.9
"""Smallest number of cells of a path, relative to the requested one."""
HOT, COLD = 1.0, 0.04
"""First and last temperature of an annealing, in cells."""
KINDS: Final = {
    DETOUR: 45,
    CUT: 45,
    CORNER: 60,
    GROW: 22,
    RETRACT: 10,
    SLITHER: 10,
    BACKBITE: 60,
    PARALLEL: 4,
}
"""How often each kind of move is tried, of 256 times (decision 0031)."""
RACE_MOVES: Final = 1_000
"""Moves for each cell in the first annealing of a placement; each round of the race has twice as
many."""
FINALISTS: Final = 3
"""Number of placements in the last annealings."""
PITCH_FACTORS: Final = tuple(0.8 + 0.04 * k for k in range(11))
"""Pitches that are tried, relative to that of N cells with the volume of the solid."""
GAP_COST: Final = 0.05
"""Loss of score for each gap in thin walls: each tunnel that the solid does not have (decision
0042)."""
MIN_TILT_GAIN: Final = 0.03
"""Smallest gain in IoU for which the solid is turned: people expect a model upright."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedPath:
    """A path in a placement.

    Attributes:
        placement: The lattice.
        cells: (n, 3) cells in the order of the path.
        iou: Intersection over union with the solid, by the fine cloud.
        score: The same by the worth of cells (see ``Placement``), less the cost of gaps in walls.
    """

    placement: Placement
    cells: Ints
    iou: float
    score: float

    @classmethod
    def along(cls, placement: Placement, path: Ints, tunnels: int | None = None) -> FittedPath:
        """Return the path through cells with flat indices.

        Args:
            placement: The lattice.
            path: (n,) flat indices.
            tunnels: Number of tunnels of a solid with thin walls; more are gaps. None for others.
        """
        score = placement.score(path)
        if tunnels is not None:
            outside = np.ones(placement.fill.shape, dtype=np.bool_)
            outside.reshape(-1)[path] = False
            # Where cells share an edge, one cannot see through.
            score -= GAP_COST * max(0, tunnels_of_cells(outside) - tunnels)
        return cls(
            placement=placement,
            cells=placement.cells_of(path),
            iou=placement.overlap(path),
            score=score,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathFit:
    """Result of a fit.

    Attributes:
        paths: Paths in one placement, the best first; at least one.
        is_final: True for the last result; False for one that is improved.
    """

    paths: tuple[FittedPath, ...]
    is_final: bool


def thresholds() -> Array:
    """Return the (1024,) thresholds of acceptance, −ln u, rounded alike on all machines."""
    shares = np.linspace(0.5, 1023.5, 1024) / 1024.0
    return np.asarray(np.round(-np.log(shares), 12), dtype=np.float64)


def schedule(moves: int, *, hot: float = HOT, cold: float = COLD) -> Schedule:
    """Return the moves of an annealing that cools geometrically."""
    kinds = np.repeat(np.array(list(KINDS)), np.array(list(KINDS.values())))
    cooling = round(float((cold / hot) ** (1.0 / max(1, moves // 256))), 12)
    return Schedule(moves, hot, cooling, thresholds(), kinds)


def field_of(placement: Placement, counts: Counts) -> Field:
    """Return the cells of a placement and the goal of a path."""
    worth = placement.worth.reshape(-1)
    return Field(
        fill=worth,
        cost=np.zeros(len(worth), np.int64),
        steps=placement.steps(),
        volume=placement.needed,
        target=float(counts.high),
        low=counts.low,
        high=counts.high,
    )


def first_step(field: Field, *, rises: bool = False) -> Ints:
    """Return a path of two cells, of the fullest cell and its fullest neighbour."""
    at = int(np.argmax(field.fill))
    near = at + (field.steps[:4] if rises else field.steps)
    return np.array([at, near[int(np.argmax(field.fill[near]))]], dtype=np.int64)


def fit_path(
    ladder: Ladder, modules: int, *, seed: int = 0, exact: bool = False
) -> Iterator[PathFit]:
    """Fit a path to a solid: a first result soon, then the final one.

    Moves are counted, not seconds: a seed gives the same paths on every machine.

    Args:
        ladder: The solid with its orientations, the upright one first.
        modules: Largest number of cells.
        seed: Random seed.
        exact: True for exactly this number of cells, False for up to a tenth fewer. Annealing may
            miss the smallest number; then the paths are shorter.
    """
    low = modules if exact else int(np.ceil(MIN_SHARE * modules))
    counts, walls = Counts(low=low, high=modules), _walls(ladder, modules)
    annealed = partial(_annealed, counts=counts, tunnels=walls.tunnels)
    runs: list[FittedPath] = []
    has_first = False
    for number, placement in enumerate(placements_of(ladder, counts, walls, seed)):
        runs.append(annealed(placement, RACE_MOVES * modules, [seed, 0, number]))
        runs = ranked(runs, low)
        if not has_first and len(runs) >= 3 and len(runs[0].cells) >= low:
            yield PathFit(paths=(runs[0],), is_final=False)
            has_first = True
    if not has_first:
        yield PathFit(paths=(runs[0],), is_final=False)
    moves, number = RACE_MOVES * modules, 1
    while len(runs) > FINALISTS:
        moves *= 2
        runs = runs[: max(FINALISTS, len(runs) // 2)]
        second_runs = [
            annealed(run.placement, moves, [seed, number, k]) for k, run in enumerate(runs)
        ]
        runs = ranked(
            [ranked(list(pair), low)[0] for pair in zip(runs, second_runs, strict=True)], low
        )
        number += 1
    finals = list(runs)
    for k, run in enumerate(runs):
        for attempt in range(2):
            moves = 6_000 * modules
            finals.append(annealed(run.placement, moves, [seed, 100 + k, attempt]))
    yield PathFit(paths=_chosen(ranked(finals, low), low), is_final=True)


def placements_of(
    ladder: Ladder,
    counts: Counts,
    walls: Walls,
    seed: int,
    *,
    lattice: Lattice = CUBES,
    upright: int = 14,
) -> Iterator[Placement]:
    """Yield the placements of the race: ``upright`` ones, and turned ones that may pay."""
    clouds = clouds_of(ladder, seeds=(2 * seed, 2 * seed + 1), wall=walls.wall)
    rng = np.random.default_rng(seed)
    best = 0.0
    for number, rotation in enumerate(ladder.turns):
        pitches = tuple(walls.pitch * factor for factor in PITCH_FACTORS)
        pitches += tuple(ladder.dividing(number, walls.pitch))
        turn = Turn(rotation=rotation, pitches=pitches, is_upright=number == 0)
        placements = best_placements(clouds, counts, turn, min_bound=best, rng=rng, lattice=lattice)
        for placement in islice(placements, upright if turn.is_upright else 1):
            if turn.is_upright:
                best = max(best, placement.bound)
            elif placement.bound < best + MIN_TILT_GAIN:
                continue
            yield placement


class Walls(NamedTuple):
    """Pitch that others are near; and for a solid with thin walls, see ``Clouds`` and ``along``."""

    pitch: float
    wall: float = np.inf
    tunnels: int | None = None


def _walls(ladder: Ladder, cells: int) -> Walls:
    """Return how cells shall treat the walls of a solid.

    Cells with the pitch p₀ have the volume V of the solid together. If its walls have the thickness
    w, their area is V/w, and as many cells one layer thick close them with the pitch p₁ =
    p₀ √(p₀/w). With a smaller pitch x p₁, cells cover the share x² of walls that are thin, and
    IoU = x² / (1 + x³ p₁/w − x²) is greatest with x³ = 2 w/p₁: walls that are thicker than half of
    p₁ are best closed, and in thinner ones, cells with the best IoU leave holes.
    """
    pitch, wall = ladder.pitch_for(cells), ladder.thickness
    closing = pitch * float(np.sqrt(pitch / wall))
    if closing < 2.5 * wall:  # below, the best cells leave few gaps: docs/decisions/0042
        return Walls(pitch)
    return Walls(closing, float(np.sqrt(2.0)) * wall, ladder.tunnels)  # a wall from edge to edge


def _annealed(
    placement: Placement, moves: int, seed: list[int], *, counts: Counts, tunnels: int | None
) -> FittedPath:
    field = field_of(placement, counts)
    number = int(np.random.SeedSequence(seed).generate_state(1)[0])
    path, _, _ = anneal(field, schedule(moves), first_step(field), number, False)
    return FittedPath.along(placement, path, tunnels)


def worth_of(score: float, placement: Placement) -> float:
    """Return a score, less what a turned solid must gain."""
    return score - (0.0 if placement.turn.is_upright else MIN_TILT_GAIN)


def _worth(run: FittedPath) -> float:
    return worth_of(run.score, run.placement)


def ranked(runs: list[FittedPath], low: int) -> list[FittedPath]:
    """Return the best paths first; those that annealing left shorter than ``low`` come last."""
    return sorted(runs, key=lambda run: (len(run.cells) < low, -_worth(run)))


def _chosen(runs: list[FittedPath], low: int) -> tuple[FittedPath, ...]:
    """Return the unknotted paths that unfold most easily of the nearly best ones; else the best.

    All are in one placement, and none has fewer cells than ``low`` if the first has not.
    """
    sound: list[tuple[float, FittedPath]] = []
    for run in runs:
        if len(run.cells) < low <= len(runs[0].cells):
            break
        if sound and _worth(run) < _worth(sound[0][1]) - 0.004:
            break
        if knot_of(run.cells).verdict == "unknot":
            sound.append((spread(run.cells), run))
    if not sound:
        return (runs[0],)
    best = min(sound, key=lambda pair: pair[0])[1]
    other_runs = [run for _, run in sorted(sound, key=lambda pair: pair[0]) if run is not best]
    same_placement = [run for run in other_runs if run.placement is best.placement]
    return (best, *same_placement[:2])
