"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

import numpy as np

from planner.folding import fold
from planner.knots import knot_of
from planner.pathfinding.exact import exact_path
from planner.paths import Path
from planner.retiming import retime
from planner.shapes import Shape
from planner.solids import Solid
from planner.voxeliser import voxelise

SMALL_SHAPE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1)]


def warm_up() -> None:
    """Finds a path, folds and retimes a tiny shape: seconds the first time, then a moment."""
    box = Shape.from_cells(np.argwhere(np.ones((3, 3, 3), dtype=bool)))
    found = exact_path(box)
    if found.cells is not None:
        knot_of(found.cells)
    voxelise(_tetrahedron(), cells=8)
    retime(fold(Path.from_cells(SMALL_SHAPE, name="warm-up")), 1.0, 1.0)


def _tetrahedron() -> Solid:
    """The simplest solid there is."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Solid(name="warm-up", vertices=corners, faces=faces, notes=())
