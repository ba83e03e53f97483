"""Fit of a trail: tetrahedra that look like a solid and through which a closed trail leads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.core import FULL, anneal_trail
from foldback.planner.core.structures import Field
from foldback.planner.path_fit.fit import MIN_SHARE, Walls, placements_of, schedule, worth_of
from foldback.planner.path_fit.placements import TETRAHEDRA, Counts, Placement
from foldback.planner.shapes.lattice_fits import Ladder


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedTetrahedra:
    """Tetrahedra in a placement, with a closed trail.

    Attributes:
        placement: The lattice.
        members: (n,) flat indices of the tetrahedra in its array ``fill``.
        iou: Intersection over union with the solid.
    """

    placement: Placement
    members: Ints
    iou: float

    @property
    def pairs(self) -> Ints:
        """(n, 2, 3) node pairs, in the placement's coordinates."""
        *lower, axis = np.unravel_index(np.sort(self.members), self.placement.fill.shape)
        nodes = np.stack(lower, axis=1).astype(np.int64)
        return np.stack([nodes, nodes + np.eye(3, dtype=np.int64)[axis]], axis=1)

    @property
    def shared(self) -> float:
        """Share of the solid's volume that is inside the tetrahedra."""
        fill = self.placement.fill.reshape(-1)
        return float(fill[self.members].sum()) / FULL / self.placement.volume

    @property
    def lost(self) -> float:
        """Share of the solid's volume in tetrahedra more than a step from the trail's nodes."""
        fill = np.maximum(self.placement.fill, 0)
        is_near: Flags = np.zeros(fill.shape[:3], dtype=np.bool_)
        is_near[tuple(self.pairs.reshape(-1, 3).T)] = True
        for axis in range(3):
            is_near |= np.roll(is_near, 1, axis) | np.roll(is_near, -1, axis)
        apart = 0
        for axis in range(3):
            is_apart = ~(is_near | np.roll(is_near, -1, axis))
            apart += int(fill[..., axis][is_apart].sum())
        return apart / FULL / self.placement.volume


def fit_trail(ladder: Ladder, modules: int, *, seed: int = 0) -> FittedTetrahedra:
    """Fit a closed trail of tetrahedra to a solid.

    Moves are counted, not seconds: a seed gives the same tetrahedra on every machine.

    Args:
        ladder: The solid with its orientations, the upright one first.
        modules: Largest number of tetrahedra; a tenth fewer are as good.
        seed: Random seed.
    """
    counts = Counts(low=int(np.ceil(MIN_SHARE * modules)), high=modules)
    walls = Walls(ladder.pitch_for(modules) / float(np.cbrt(TETRAHEDRA.volume)))
    placements = placements_of(ladder, counts, walls, seed, lattice=TETRAHEDRA, upright=5)
    runs = [
        _annealed(placement, counts, 500 * modules, [seed, 0, number])
        for number, placement in enumerate(placements)
    ]
    finals = sorted(runs, key=_worth)[-3:]
    finals += [
        _annealed(run.placement, counts, 2_000 * modules, [seed, 1 + k, attempt])
        for k, run in enumerate(finals)
        for attempt in range(2)
    ]
    return max(finals, key=_worth)


def _worth(run: FittedTetrahedra) -> float:
    return worth_of(run.iou, run.placement)


def _annealed(
    placement: Placement, counts: Counts, moves: int, seed: list[int]
) -> FittedTetrahedra:
    fill = placement.fill.reshape(-1)
    field = Field(
        fill=fill,
        cost=np.zeros_like(fill),
        steps=placement.steps(),
        volume=placement.volume,
        target=float(counts.high),
        low=counts.low,
        high=counts.high,
    )
    odd = np.indices(placement.fill.shape[:3]) % 2
    parities = np.ascontiguousarray((4 * odd[0] + 2 * odd[1] + odd[2]).reshape(-1))
    number = int(np.random.SeedSequence(seed).generate_state(1)[0])
    corner = int(np.argmax(fill)) // 3
    members, _ = anneal_trail(field, schedule(moves), parities, corner, number)
    return FittedTetrahedra(placement=placement, members=members, iou=placement.overlap(members))
