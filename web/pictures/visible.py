"""Visible modules: which of a long chain have to be drawn for a picture."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from planner.chain.module import Module

Array = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

MOST_DRAWN: Final = 4000
"""Modules up to which all of a chain are drawn."""
TOUCHING: Final = 1.02
"""Pitches between centres up to which cubes share a face."""


def visible_modules(positions: Array, module: Module, *, target: Array) -> Ints:
    """The modules to draw, in order: those that are not buried among others, and the nearest.

    Args:
        positions: (n, 3) centres.
        module: The kind of module.
        target: (3,) what the camera looks at.
    """
    found = np.arange(len(positions))
    if len(found) <= MOST_DRAWN:
        return found
    if module.fills_cell:
        near = KDTree(positions).query_ball_point(positions, TOUCHING, return_length=True)
        found = found[np.asarray(near) <= len(module.face_normals) * 2]
    if len(found) > MOST_DRAWN:
        away = np.linalg.norm(positions[found] - target, axis=1)
        found = np.sort(found[np.argpartition(away, MOST_DRAWN)[:MOST_DRAWN]])
    return found
