"""Folded core: the modules of a chain that are still folded, on their lattice."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.errors import InputError
from planner.kernels.folded_core import box_cover, distances_at

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
FIELD_PADDING_CELLS: Final = 6
"""Width of the margin around the core in which distances to it are stored, cells. Larger values are
exact farther out and take more memory. Chosen."""
RAY_DIRECTIONS: Final = 400
"""Number of directions, evenly over the sphere, in which a rod is tested. Chosen."""
RAY_STEP_PITCH: Final = 0.5
"""Distance of two samples of a ray, pitches. Smaller values miss fewer obstacles. Chosen."""
RAY_CLEARANCE_PITCH: Final = 2.0
"""Wanted distance of a ray from the core, pitches; near its start it is less. Larger values choose
freer rays. Chosen."""


class Core:
    """Cells of the folded modules, in the frame of module 0.

    Attributes:
        cells: (n, 3) cells of the modules, float64.
        rotations: (n, 3, 3) their orientations when folded.
        grid: (X, Y, Z) int32 number of the module in each cell, −1 for none.
        low: (3,) first cell of the grid.
    """

    def __init__(self, chain: Chain) -> None:
        if not chain.module.fills_cell or chain.module.rigid_links != 1:
            raise InputError(
                "not-peelable",
                f"got a chain of the module {chain.module.name}, expected cubes; use another "
                "strategy.",
            )
        folded = forward_kinematics(chain.module, chain.folded_rad)
        cells = np.rint(folded.positions)
        if np.abs(folded.positions - cells).max() > 1e-3:
            raise InputError(
                "not-peelable",
                "got a folded chain whose modules are off the cubic lattice, expected angles of 0 "
                "or ±90°; use another strategy.",
            )
        self.cells = cells
        self.rotations = np.rint(folded.rotations)
        self.low = cells.min(axis=0).astype(np.int64)
        whole = cells.astype(np.int64) - self.low
        self.grid = np.full(whole.max(axis=0) + 1, -1, dtype=np.int32)
        self.grid[tuple(whole.T)] = np.arange(len(cells), dtype=np.int32)
        self._boxes = np.empty((len(cells), 6), dtype=np.int64)

    def boxes(self, last: int) -> tuple[Array, Array]:
        """Return (B, 3) centres and half sides of boxes that hold the modules 0 to ``last``."""
        count = box_cover(self.grid, last, self._boxes)
        found = self._boxes[:count].astype(np.float64)
        half = 0.5 * found[:, 3:]
        return found[:, :3] + self.low - 0.5 + half, half

    def extent(self, last: int) -> Ints:
        """Return the (2, 3) smallest and largest cell of the modules 0 to ``last``."""
        cells = self.cells[: last + 1]
        return np.stack([cells.min(axis=0), cells.max(axis=0)]).astype(np.int64)

    def distances(self, last: int) -> Array:
        """Return the distance of each cell of the padded grid to the nearest folded one."""
        from scipy.ndimage import distance_transform_edt  # late: it takes a while

        there = np.pad((self.grid >= 0) & (self.grid <= last), FIELD_PADDING_CELLS)
        return np.asarray(distance_transform_edt(~there), dtype=np.float64)

    def distance_at(self, field: Array, points: Array) -> Array:
        """Return rough (...,) distances of (..., 3) points to the core, outside the field too."""
        found = np.empty(points.shape[:-1])
        low = (self.low - FIELD_PADDING_CELLS).astype(np.float64)
        distances_at(field, low, points.reshape(-1, 3), found.reshape(-1))
        return found

    def way_out(self, field: Array, start: Array, last: int, before: Array | None) -> Array:
        """Return the (3,) unit vector of the free ray from a point that is nearest to radial.

        Args:
            field: Distances to the core, see ``distances``.
            start: (3,) start of the ray.
            last: Last module of the core.
            before: (3,) ray of the unit before; rays near it are preferred a little.
        """
        centre = self.cells[: last + 1].mean(axis=0)
        radial = start - centre
        radial = radial / max(float(np.linalg.norm(radial)), 1e-9)
        rays = _directions()
        reach = float(np.linalg.norm(np.array(self.grid.shape))) + FIELD_PADDING_CELLS
        along = np.arange(1.0, reach, RAY_STEP_PITCH)
        points = start + rays[:, None, :] * along[None, :, None]
        distance = self.distance_at(field, points)
        wanted = np.minimum(RAY_CLEARANCE_PITCH, 0.7 + 0.5 * along)
        lack = np.maximum(wanted - distance, 0.0).max(axis=1)
        score = rays @ radial - 3.0 * lack
        if before is not None:
            score = score + 0.5 * (rays @ before)
        return np.asarray(rays[int(np.argmax(score))])


def _directions() -> Array:
    """Return (RAY_DIRECTIONS + 6, 3) unit vectors: evenly over the sphere, and the axes."""
    k = np.arange(RAY_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / RAY_DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    even = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    return np.concatenate([even, np.eye(3), -np.eye(3)])
