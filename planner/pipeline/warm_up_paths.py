"""Warm-up of what reads shapes and finds paths: compiles its kernels into their cache."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import TETRAHEDRON
from foldback.planner.chain.path import Path
from foldback.planner.path_fit.fill_fitted import fill_fitted
from foldback.planner.path_fit.fill_trail import fill_with_trail
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.knots import knot_of, knot_of_polygon
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pathfinding.trail_search import find_trails
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import voxelise

WARM_UP_CELLS: Final = (
    *((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
    *((0, 1, 1), (1, 1, 1), (1, 0, 1)),
)


def warm_up_chains() -> Chain:
    """Make a small chain of a path."""
    chain = Chain.from_path(Path.from_cells(list(WARM_UP_CELLS), name="warm-up"))
    _ = chain.folded_poses
    return chain


def warm_up_paths() -> None:
    """Finds a path and a trail through a box and makes voxels of a tetrahedron."""
    warm_up_chains()
    box = Shape.from_cells(np.argwhere(np.ones((3, 3, 3), dtype=bool)))
    search = exact_path(box)
    if search.cells is not None:
        knot_of(search.cells)
    find_trails(box)
    solid = _tetrahedron()
    voxelise(solid, cells=8)
    # One whose faces don't agree about what is outside is filled in another way.
    voxelise(replace(solid, oriented=False), cells=8)


def warm_up_fit() -> None:
    """Fit a path and a trail to a tetrahedron, and test a knot, which only some chains have."""
    fill_fitted(_tetrahedron(), PathOptions(modules=8), seed=0)
    fill_with_trail(_tetrahedron(), PathOptions(modules=24, module=TETRAHEDRON.name), seed=0)
    knot_of_polygon(_trefoil(), np.random.default_rng(0))


def _trefoil() -> Array:
    """Return (12, 3) corners of a trefoil knot, the simplest knot there is."""
    angle = np.arange(12) * np.pi / 6
    x = np.sin(angle) + 2 * np.sin(2 * angle)
    y = np.cos(angle) - 2 * np.cos(2 * angle)
    return np.column_stack([x, y, -np.sin(3 * angle)])


def _tetrahedron() -> Solid:
    """Return the simplest solid there is."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Solid(name="warm-up", vertices=corners, faces=faces, notes=())
