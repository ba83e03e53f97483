"""Picking: which module a ray through the scene meets first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.modules import Module
from planner.rotations import matrix_from_wxyz

Array = NDArray[np.float64]


def picked_module(
    module: Module, positions: Array, wxyzs: Array, origin: Array, direction: Array
) -> int | None:
    """Index of the nearest module that a ray meets, or None.

    Viser could tell which instance was clicked, but it then outlines whatever lies under the
    pointer in a colour of its own.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        wxyzs: (n, 4) orientations.
        origin: (3,) where the ray starts, in pitches.
        direction: (3,) where it goes.
    """
    turns = matrix_from_wxyz(wxyzs.astype(np.float64))
    starts = np.einsum("nji,nj->ni", turns, origin - positions)
    ways = np.einsum("nji,j->ni", turns, direction)
    heights = module.vertices @ module.face_normals.T
    along = ways @ module.face_normals.T
    at = starts @ module.face_normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (heights.min(axis=0) - at) / along
        second = (heights.max(axis=0) - at) / along
    enter = np.nanmax(np.minimum(first, second), axis=1)
    leave = np.nanmin(np.maximum(first, second), axis=1)
    met = (enter <= leave) & (leave > 0)
    if not met.any():
        return None
    return int(np.argmin(np.where(met, enter, np.inf)))
