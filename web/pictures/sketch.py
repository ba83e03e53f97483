"""Sketch: the data with which a page draws a fold on a 2D canvas.

The 3D view takes seconds to start on a slow machine and does not work without WebGL. The sketch
shows the same frame, poses, colours and camera with the browser's 2D canvas.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.chain.module import Module
from web.pictures.camera import FIELD_OF_VIEW_RAD
from web.pictures.meshes import DISPLAYED_MODULE_SIZE, FLAT_TOLERANCE

Array = NDArray[np.float64]


def sketch_outline(module: Module, modules: int) -> dict[str, Any]:
    """Return the data that all frames share, as JSON: the displayed hull and the field of view.

    ``corners`` (V, 3) are in pitches, ``faces`` lists the corners of each flat face,
    counterclockwise from outside, ``normals`` is (F, 3), and ``field_of_view_rad`` is vertical.
    """
    corners = module.vertices * DISPLAYED_MODULE_SIZE
    faces: list[list[int]] = []
    normals: list[list[float]] = []
    for normal in np.concatenate([module.face_normals, -module.face_normals]):
        reach = corners @ normal
        on = np.flatnonzero(reach > reach.max() - FLAT_TOLERANCE)
        if len(on) < 3:  # the hull is not symmetric: no face on this side
            continue
        faces.append([int(k) for k in on[_around(corners[on], normal)]])
        normals.append([float(v) for v in normal])
    return {
        "modules": modules,
        "corners": corners.tolist(),
        "faces": faces,
        "normals": normals,
        "field_of_view_rad": float(FIELD_OF_VIEW_RAD),
    }


def _around(corners: Array, normal: Array) -> NDArray[np.int64]:
    """Return the order of a flat face's corners, counterclockwise about its outward normal."""
    spread = corners - corners.mean(axis=0)
    right = spread[0] / np.linalg.norm(spread[0])
    up = np.cross(normal, right)
    return np.argsort(np.arctan2(spread @ up, spread @ right))
