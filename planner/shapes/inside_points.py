"""Inside points: points spread evenly in the volume of a solid, for measuring overlaps.

The points are the inside samples of a grid that lies askew to the axes of the file and to those of
the solid. No lattice of cells is aligned with it, so a search that fits cells to the samples of its
own lattice cannot fit these points as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.shapes.orientations import main_axes
from foldback.planner.shapes.solid import Solid, signed_volume
from foldback.planner.shapes.solid_sampling import Sampling, enclosed_volume, grid_of, sample

MAX_TURNED_SAMPLES: Final = 6_000_000
"""Maximum number of samples of the grid. Solids that fill little of their bounding box get fewer
points."""
TILT_AXIS: Final = (0.4812, 0.3574, 0.8005)
"""Direction about which the grid is turned; it is near no axis, diagonal or plane of symmetry."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InsidePoints:
    """Points spread evenly in the volume of an input.

    Attributes:
        points: (P, 3) in the input's units.
        volume: Volume of the input, in its units.
    """

    points: Array
    volume: float

    def moved(self, rotation: Array, scale: float, shift: Array | float) -> InsidePoints:
        """Return the points x at ``scale · rotation @ x + shift``."""
        return InsidePoints(
            points=scale * (self.points @ rotation.T) + shift, volume=scale**3 * self.volume
        )


def inside_points(solid: Solid, *, count: int = 100_000) -> InsidePoints:
    """Spread about ``count`` points evenly in a solid, all of its bodies.

    Raises:
        InputError: ``no-volume`` if the solid encloses no volume.
    """
    spacing, rotation = _grid(solid, count)
    sampling = sample(solid, pitch=2.0 * spacing, size=2, rotation=rotation)
    inside = points_of(sampling)
    if solid.oriented and sampling.crossed == 0.0:
        volume = abs(signed_volume(solid.vertices, solid.faces)) or inside.volume
        return replace(inside, volume=volume)
    return inside


def points_of(sampling: Sampling) -> InsidePoints:
    """Return the middles of the samples inside."""
    middles = np.argwhere(sampling.inside) + 0.5 - sampling.offset
    points = turned(middles * (sampling.pitch / sampling.size), sampling.rotation.T)
    return InsidePoints(points=points, volume=sampling.volume)


def turned(points: Array, rotation: Array) -> Array:
    """Return (p, 3) turned points; term by term, so that all machines round them alike."""
    x, y, z = points.T
    rows = [row[0] * x + row[1] * y + row[2] * z for row in rotation]
    return np.ascontiguousarray(np.stack(rows, axis=1))


def _grid(solid: Solid, count: int) -> tuple[float, Array]:
    """Return the spacing and (3, 3) rotation of the most askew grid that is small enough."""
    spacing = float(np.cbrt(enclosed_volume(solid) / count))
    grids: list[tuple[float, Array]] = []
    # The first one whose grid is small enough: a long thin solid that lies askew fills hardly
    # anything of its box.
    for tilt_rad in (2.0, 0.5, 0.15, 0.05):
        for base in (np.eye(3), main_axes(solid)):
            rotation = _tilt(tilt_rad) @ base
            samples = _grid_samples(np.ptp(solid.vertices @ rotation.T, axis=0), spacing)
            if samples <= MAX_TURNED_SAMPLES:
                return spacing, rotation
            grids.append((samples, rotation))
    samples, rotation = min(grids, key=lambda grid: grid[0])
    extents = np.ptp(solid.vertices @ rotation.T, axis=0)
    while _grid_samples(extents, spacing) > MAX_TURNED_SAMPLES:
        spacing *= 1.1
    return spacing, rotation


def _grid_samples(extents: Array, spacing: float) -> float:
    return float(np.prod(grid_of(extents, 2.0 * spacing, 2).astype(np.float64)))


def _tilt(angle_rad: float) -> Array:
    """Return the (3, 3) rotation by an angle about ``TILT_AXIS``."""
    half = 0.5 * angle_rad
    return matrix_from_wxyz(np.array([np.cos(half), *(np.sin(half) * np.array(TILT_AXIS))]))
