"""Sketch: what a page needs to draw a fold by itself on a plain canvas.

The 3D view takes seconds to start on a slow machine and is not there at all without WebGL. The
sketch is: the same playhead, poses, colours and camera, drawn by the browser's 2D canvas.
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
    """Return what is the same in all frames, as JSON: the drawn hull and the camera's lens.

    ``corners`` (V, 3) in pitches, ``faces`` lists of corners that turn outwards, one for each flat
    face, ``normals`` (F, 3), ``field_of_view_rad`` from top to bottom.
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
    """Return the order of the corners of a flat face, turning left about its outward normal."""
    spread = corners - corners.mean(axis=0)
    right = spread[0] / np.linalg.norm(spread[0])
    up = np.cross(normal, right)
    return np.argsort(np.arctan2(spread @ up, spread @ right))
