"""Sketch: what a page needs to draw a fold by itself on a plain canvas, frame by frame.

The 3D view takes seconds to start on a slow machine and is not there at all without WebGL. The
sketch is: it is the same playhead, the same poses, the same colours, the same camera, sent as one
small message a frame and drawn by the browser's 2D canvas.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.modules import Module
from web.camera import FIELD_OF_VIEW_RAD, View
from web.film import Snapshot
from web.meshes import SHOWN_SIZE

Array = NDArray[np.float64]
SketchMessage = dict[str, Any] | bytes
Watcher = Callable[[SketchMessage], None]

FLAT_TOLERANCE = 1e-6


def sketch_outline(module: Module, modules: int) -> dict[str, Any]:
    """What holds for all frames, as JSON: the drawn hull of a module and how the camera sees.

    ``corners`` (V, 3) in pitches, ``faces`` lists of corners that turn outwards, one for each flat
    face, ``normals`` (F, 3), ``field_of_view_rad`` from top to bottom.
    """
    corners = module.vertices * SHOWN_SIZE
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
        "is": "sketch",
        "modules": modules,
        "corners": corners.tolist(),
        "faces": faces,
        "normals": normals,
        "field_of_view_rad": float(FIELD_OF_VIEW_RAD),
    }


def sketch_frame(
    snapshot: Snapshot, colours: NDArray[np.uint8], view: View, *, pitch: float, ground: float
) -> bytes:
    """One frame: little-endian float32 numbers, then the colours as bytes.

    The numbers are the frame, the camera's position (3), the point that it looks at (3), the
    height of the ground, then for each of the n modules its centre (3) and orientation as a
    quaternion w, x, y, z (4); the colours are (n, 3) sRGB bytes. Lengths are in pitches.

    Args:
        snapshot: What is shown.
        colours: (n, 3) sRGB bytes.
        view: The camera, in units of a scene in which a pitch has the length ``pitch``.
        pitch: That length.
        ground: Height of the ground in the scene's units.
    """
    numbers = np.empty(8 + 7 * len(snapshot.positions), "<f4")
    numbers[0] = snapshot.frame
    numbers[1:4] = view.position / pitch
    numbers[4:7] = view.target / pitch
    numbers[7] = ground / pitch
    poses = numbers[8:].reshape(-1, 7)
    poses[:, :3] = snapshot.positions
    poses[:, 3:] = snapshot.wxyzs
    return numbers.tobytes() + np.ascontiguousarray(colours, np.uint8).tobytes()


def _around(corners: Array, normal: Array) -> NDArray[np.int64]:
    """The order of the corners of a flat face, turning left about its outward normal."""
    spread = corners - corners.mean(axis=0)
    right = spread[0] / np.linalg.norm(spread[0])
    up = np.cross(normal, right)
    return np.argsort(np.arctan2(spread @ up, spread @ right))
