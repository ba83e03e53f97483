"""Cloud: points spread evenly through the inside of a solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.arrays import Array
from planner.shapes.bridges import parts_of
from planner.shapes.solid import Solid
from planner.shapes.solid_sampling import grid_of, sample

MAX_SAMPLES: Final = 12_000_000
"""Maximum number of samples of the box around a solid, to find the points inside."""
TILT_RAD: Final = (0.1, 0.3)
"""Range of the angles about each axis by which the grid of samples is turned against the solid, so
that no lattice that is laid over the solid is parallel to it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """Points inside a solid.

    Attributes:
        points: (p, 3) points, in the solid's units.
        each: Volume that a point stands for.
        vertices: (v, 3) vertices of the solid.
    """

    points: Array
    each: float
    vertices: Array

    @property
    def volume(self) -> float:
        """Volume of the solid."""
        return len(self.points) * self.each


def cloud(
    solid: Solid, volume: float, count: int, *, turns: tuple[Array, ...], largest: bool, seed: int
) -> Cloud:
    """Return about ``count`` points inside a solid.

    They are the points of a grid that is turned against the solid. A search over lattices can
    therefore not fit the grid instead of the solid.

    Args:
        solid: The solid.
        volume: Its volume, about.
        count: Requested number of points; solids that fill little of their box get fewer.
        turns: Rotations of the solid; the grid is nearly parallel to the box with the least volume.
        largest: True for its largest body alone.
        seed: Random seed.
    """
    rng = np.random.default_rng(seed)
    boxes = [float(np.prod(np.ptp(solid.vertices @ turn.T, axis=0))) for turn in turns]
    turn = turns[int(np.argmin(boxes))]
    for axis in range(3):
        turn = _about(axis, float(rng.uniform(*TILT_RAD))) @ turn
    extents = np.ptp(solid.vertices @ turn.T, axis=0)
    edge = float(np.cbrt(volume / count))
    while float(np.prod(grid_of(extents, 2.0 * edge, 2).astype(np.float64))) > MAX_SAMPLES:
        edge *= 1.05
    sampling = sample(solid, pitch=2.0 * edge, size=2, rotation=turn)
    inside = sampling.inside
    if largest:
        numbers, sizes = parts_of(inside)
        inside = numbers == int(np.argmax(sizes)) + 1
    at = np.argwhere(inside)
    placed = (at + 0.5 - sampling.offset) * edge
    return Cloud(points=turned(placed, turn.T), each=edge**3, vertices=solid.vertices)


def turned(points: Array, rotation: Array) -> Array:
    """Return (p, 3) turned points; term by term, so that all machines round them alike."""
    x, y, z = points.T
    rows = [row[0] * x + row[1] * y + row[2] * z for row in rotation]
    return np.ascontiguousarray(np.stack(rows, axis=1))


def _about(axis: int, angle_rad: float) -> Array:
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i] = rotation[j, j] = np.cos(angle_rad)
    rotation[i, j], rotation[j, i] = -np.sin(angle_rad), np.sin(angle_rad)
    return rotation
