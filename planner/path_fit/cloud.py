"""Clouds: points spread evenly through the inside of a solid, to lay lattices over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.shapes.inside_points import InsidePoints, points_of
from foldback.planner.shapes.lattice_fits import Ladder, largest_body
from foldback.planner.shapes.orientations import about_axis
from foldback.planner.shapes.solid_sampling import grid_of, sample


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clouds:
    """A solid as points.

    Attributes:
        vertices: (v, 3) vertices of its surface.
        rough: Points inside by which placements are compared.
        fine: Points inside by which the cells of a placement are filled.
        wall: Thickness of a wall that makes a cell full of which it covers a face's area, in its
            units; for solids with walls much thinner than a cell. Infinite for others.
    """

    vertices: Array
    rough: InsidePoints
    fine: InsidePoints
    wall: float


def clouds_of(ladder: Ladder, *, seeds: tuple[int, int], wall: float = np.inf) -> Clouds:
    """Return a solid as points, with a random seed for each of both sets."""
    rough, fine = (
        _cloud(ladder, count, seed) for count, seed in zip((24_000, 120_000), seeds, strict=True)
    )
    return Clouds(vertices=ladder.solid.vertices, rough=rough, fine=fine, wall=wall)


def _cloud(ladder: Ladder, count: int, seed: int) -> InsidePoints:
    """Return about ``count`` points inside the used bodies of a solid.

    They are the points of a grid that is turned against the solid. A search over lattices can
    therefore not fit the grid instead of the solid. It is turned by other angles than the points
    that measure the likeness, and is nearly parallel to the box with the least volume.

    Args:
        ladder: The solid.
        count: Requested number of points; solids that fill little of their box get fewer.
        seed: Random seed.
    """
    rng = np.random.default_rng(seed)
    turn = ladder.turns[int(np.argmin([np.prod(extents) for extents in ladder.extents]))]
    for axis in range(3):
        # no lattice that is laid over the solid is parallel to the grid
        turn = about_axis(axis, float(rng.uniform(0.1, 0.3))) @ turn
    extents = np.ptp(ladder.solid.vertices @ turn.T, axis=0)
    edge = float(np.cbrt(ladder.volume / count))
    while float(np.prod(grid_of(extents, 2.0 * edge, 2).astype(np.float64))) > 12_000_000:
        edge *= 1.05
    sampling = sample(ladder.solid, pitch=2.0 * edge, size=2, rotation=turn)
    return points_of(largest_body(sampling) if ladder.apart else sampling)
