"""Surroundings of a window: the modules that are still folded, on their lattice, and a table."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.table_projection import TableProjection
from foldback.planner.core import box_cover, distances_at, write_core_distances
from foldback.planner.core.structures import CoreField
from foldback.planner.errors import InputError

FIELD_PADDING_CELLS: Final = 6
"""Width, in lattice cells, of the margin around the folded core in which the distance field of the
core is stored; distances are rough outside of it."""
MAX_FIELD_CELLS: Final = 8
"""Distance from the core, in lattice cells, above which the distance field does not tell distances
apart. Springs have their full stiffness there, and rays are free from 2 cells on."""
RAY_DIRECTIONS: Final = 400
"""Number of directions, evenly spread over the sphere, among which the exit direction of the
chain's straight tail is chosen."""
RAYS_AT_ONCE: Final = 16
"""Number of rays whose distances from the core are computed at once, the most promising first."""
TABLE_THICKNESS_PITCH: Final = 40.0
"""Thickness of the box that represents the table in contact detection, pitches: so large that
contacts never push a module out through its bottom, as they might with smaller values."""
HEADING_COUNT: Final = 72
"""Number of directions along the table, evenly over a full turn, among which the direction of the
chain's straight tail is chosen."""


class Core:
    """Cells of the folded modules, in the frame of module 0.

    Attributes:
        cells: (n, 3) cells of the modules, float64.
        rotations: (n, 3, 3) their orientations when folded.
        grid: (X, Y, Z) int32 number of the module in each cell, −1 for none.
        low: (3,) first cell of the grid.
    """

    def __init__(self, chain: Chain) -> None:
        if not chain.module.follows_paths:
            raise InputError(
                "not-peelable",
                f"got a chain of {chain.module.words.plural}, expected modules that fold "
                "along any path of cells; use a strategy other than peel.",
            )
        folded = forward_kinematics(chain.module, chain.folded_rad)
        cells = np.rint(folded.positions)
        if np.abs(folded.positions - cells).max() > 1e-3:
            raise InputError(
                "not-peelable",
                "got a folded chain whose modules lie between the cells of the cubic lattice, "
                "expected hinge angles of 0 or ±90°; use a strategy other than peel.",
            )
        self.cells = cells
        self.rotations = np.rint(folded.rotations)
        self.low = cells.min(axis=0).astype(np.int64)
        grid_cells = cells.astype(np.int64) - self.low
        self.grid = np.full(grid_cells.max(axis=0) + 1, -1, dtype=np.int32)
        self.grid[tuple(grid_cells.T)] = np.arange(len(cells), dtype=np.int32)
        self._boxes = np.empty((len(cells), 6), dtype=np.int64)
        # Of the modules 0 to i, for each i: a long chain asks at every release.
        self._lowest = np.minimum.accumulate(cells, axis=0)
        self._highest = np.maximum.accumulate(cells, axis=0)
        self._sums = np.cumsum(cells, axis=0)
        padded = np.array(self.grid.shape) + 2 * FIELD_PADDING_CELLS
        self._distances = np.full(padded, float(MAX_FIELD_CELLS))
        self._field_last = -1

    def boxes(self, last: int) -> tuple[Array, Array]:
        """Return (B, 3) centres and half sides of boxes that hold the modules 0 to ``last``."""
        count = box_cover(self.grid, last, self._boxes)
        rows = self._boxes[:count].astype(np.float64)
        half = 0.5 * rows[:, 3:]
        return rows[:, :3] + self.low - 0.5 + half, half

    def extent(self, last: int) -> Ints:
        """Return the (2, 3) smallest and largest cell of the modules 0 to ``last``."""
        return np.stack([self._lowest[last], self._highest[last]]).astype(np.int64)

    def distances(self, last: int) -> CoreField:
        """Return the distance of each cell of the padded grid to the nearest folded one.

        At most ``MAX_FIELD_CELLS``. The next call writes to the same array, and only near the
        modules that have joined or left the core.

        Args:
            last: Last module of the core.
        """
        changed = slice(min(last, self._field_last) + 1, max(last, self._field_last) + 1)
        if changed.start < changed.stop:
            cells = self.cells[changed].astype(np.int64) - self.low + FIELD_PADDING_CELLS
            box = np.stack(
                [cells.min(axis=0) - MAX_FIELD_CELLS, cells.max(axis=0) + MAX_FIELD_CELLS]
            )
            box = np.clip(box, 0, np.array(self._distances.shape) - 1)
            write_core_distances(self.grid, last, MAX_FIELD_CELLS, box, self._distances)
            self._field_last = last
        return CoreField(self._distances, (self.low - FIELD_PADDING_CELLS).astype(np.float64))

    def exit_direction(
        self, field: CoreField, start: Array, last: int, before: Array | None
    ) -> Array:
        """Return the (3,) unit vector of the free ray from a point that is nearest to radial.

        Args:
            field: Distances to the core, see ``distances``.
            start: (3,) start of the ray.
            last: Last module of the core.
            before: (3,) ray of the unit before; rays near it are preferred a little.
        """
        centre = self._sums[last] / (last + 1)
        radial = start - centre
        radial = radial / max(float(np.linalg.norm(radial)), 1e-9)
        rays = ray_directions()
        outwards = rays @ radial
        as_before = np.zeros(len(rays)) if before is None else 0.5 * (rays @ before)
        bounds = outwards + as_before
        best_score, best = -np.inf, 0
        # Most of the best rays are free, and no score exceeds its bound.
        order = np.argsort(-bounds, kind="stable")
        for some in np.split(order, range(RAYS_AT_ONCE, len(order), RAYS_AT_ONCE)):
            if bounds[some[0]] < best_score:
                break
            lack = self._lack(field, start, rays[some])
            scores = outwards[some] - 3.0 * lack + as_before[some]
            for score, ray in zip(scores.tolist(), some.tolist(), strict=True):
                if score > best_score or (score == best_score and ray < best):
                    best_score, best = score, ray
        return rays[best].copy()

    def _lack(self, field: CoreField, start: Array, rays: Array) -> Array:
        """Return by how much (R, 3) rays are too near to the core, pitches."""
        reach = float(np.linalg.norm(np.array(self.grid.shape))) + FIELD_PADDING_CELLS
        along = np.arange(1.0, reach, 0.5)
        points = start + rays[:, None, :] * along[None, :, None]
        min_distances = np.minimum(2.0, 0.7 + 0.5 * along)
        return np.maximum(min_distances - distance_at(field, points), 0.0).max(axis=1)


class CoreOnTable:
    """Core of a chain that stands on a table, and that table.

    Args:
        core: The core.
        projection: Projection onto the table.
    """

    def __init__(self, core: Core, projection: TableProjection) -> None:
        self._core = core
        self._projection = projection
        self._lowest = float((core.cells @ projection.up).min())
        """Height of the centres of modules that stand on the table, pitches along ``up``."""

    def boxes(self, last: int) -> tuple[Array, Array]:
        """Return (B, 3) centres and half sides of boxes: the modules 0 to ``last``, the table."""
        centres, halves = self._core.boxes(last)
        up = self._projection.up
        # Not where the chain begins on the floor: its first free module would be jammed there.
        raised = float(self._core.cells[last + 1] @ up) > self._lowest + 0.5
        # contacts give: without a lift, modules sink into the real table
        top = self._lowest - 0.5 + (0.006 if raised else 0.0)
        # longer than any chain reaches
        table = np.where(up != 0.0, 0.5 * TABLE_THICKNESS_PITCH, 1000.0)
        return (
            np.concatenate([centres, [(top - 0.5 * TABLE_THICKNESS_PITCH) * up]]),
            np.concatenate([halves, [table]]),
        )

    def exit_direction(
        self, field: CoreField, start: Array, last: int, before: Array | None
    ) -> Array:
        """Return the (3,) unit vector along the table, clear of the core.

        Args:
            field: Without effect.
            start: (3,) start of the rod, pitches.
            last: Last module of the core.
            before: (3,) direction of the unit before; None if there is none.
        """
        del field
        projection, cells = self._projection, self._core.cells[: last + 1]
        rays = projection.along(2.0 * np.pi * np.arange(HEADING_COUNT) / HEADING_COUNT)
        outwards = projection.project(start - cells.mean(axis=0)) @ projection.across
        along = np.arange(1.0, 12.0, 0.5)
        points = projection.project(start + rays[:, None, :] * along[None, :, None])
        gaps = points[:, :, None, :] - np.unique(projection.project(cells), axis=0)
        distance = np.linalg.norm(gaps, axis=-1).min(axis=-1)
        min_distances = np.minimum(1.8, 0.7 + 0.5 * along)
        lack = np.maximum(min_distances - distance, 0.0).max(axis=1)
        # Away from the core's middle, on in the direction in which the chain leaves it, as before,
        # and clear of the core.
        score = (
            0.3 * (rays @ outwards) / max(float(np.linalg.norm(outwards)), 1e-9)
            + 2.0 * (rays @ self._core.rotations[last][:, 0])
            + 0.7 * (rays @ (np.zeros(3) if before is None else before))
            - 3.0 * lack
        )
        return np.asarray(rays[int(np.argmax(score))])


def distance_at(field: CoreField, points: Array) -> Array:
    """Return rough (...,) distances of (..., 3) points to the core, outside the field too."""
    distances = np.empty(points.shape[:-1])
    distances_at(*field, points.reshape(-1, 3), distances.reshape(-1))
    return distances


def ray_directions() -> Array:
    """Return (RAY_DIRECTIONS + 6, 3) unit vectors: evenly over the sphere, and the axes."""
    k = np.arange(RAY_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / RAY_DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    even = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    return np.concatenate([even, np.eye(3), -np.eye(3)])
