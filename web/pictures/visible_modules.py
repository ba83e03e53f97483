"""Visible modules: the modules of a long chain that have to be drawn for a picture."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from foldback.planner.chain.module import Module

Array = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

MAX_FULLY_DRAWN_MODULES: Final = 4000
"""Maximum number of modules of a chain that are drawn in pictures and movies. Of longer chains
hidden modules, then those farthest from the camera's target, are left out."""


def visible_modules(positions: Array, module: Module, *, target: Array) -> Ints:
    """Return the modules to draw, in order: those not hidden among others, and the nearest.

    Args:
        positions: (n, 3) centres.
        module: The kind of module.
        target: (3,) target of the camera.
    """
    indices = np.arange(len(positions))
    if len(indices) <= MAX_FULLY_DRAWN_MODULES:
        return indices
    if module.fills_cell:
        # 1 and rounding
        near = KDTree(positions).query_ball_point(positions, 1.02, return_length=True)
        indices = indices[np.asarray(near) <= len(module.pieces[0].parts[0].loops)]
    if len(indices) > MAX_FULLY_DRAWN_MODULES:
        distances = np.linalg.norm(positions[indices] - target, axis=1)
        indices = np.sort(
            indices[np.argpartition(distances, MAX_FULLY_DRAWN_MODULES)[:MAX_FULLY_DRAWN_MODULES]]
        )
    return indices
