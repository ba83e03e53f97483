"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

import numpy as np

from planner.chain import Chain
from planner.dynamics import floating_torques
from planner.folding import fold
from planner.knots import knot_of
from planner.measuring import clearances_of
from planner.modules import CUBE
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
    path = Path.from_cells(SMALL_SHAPE, name="warm-up")
    retime(fold(path), 1.0, 1.0)
    still = np.tile(Chain.from_path(path).folded_rad, (2, 1))
    clearances_of(Chain.from_path(path), still, size=0.95)
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)


def _tetrahedron() -> Solid:
    """The simplest solid there is."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Solid(name="warm-up", vertices=corners, faces=faces, notes=())
