"""Meshes of modules as they are drawn: a little smaller than the pitch, with bevelled edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD

Array = NDArray[np.float64]
DISPLAYED_MODULE_SIZE: Final = 0.93
"""Size of a displayed module relative to its true size, so that gaps separate neighbouring
modules."""
STUD_RADIUS: Final = 0.21
"""Radius of the disc that marks the free end of a displayed chain, in pitches."""
STUD_SIDES: Final = 20
"""Number of sides of the polygon that approximates the disc at the free end of a displayed
chain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles: ``vertices`` (V, 3) and ``faces`` (F, 3), counterclockwise from outside."""

    vertices: Array
    faces: NDArray[np.int64]


def module_mesh(module: Module) -> Mesh:
    """Return a module's hull, shrunk to leave a gap, with bevelled edges and corners."""
    outline = sketch_outline(module, 1)
    corners: Array = np.array(outline["corners"])
    return hull_mesh(np.concatenate([inset(corners[ring]) for ring in outline["faces"]]))


def sketch_outline(module: Module, modules: int) -> dict[str, Any]:
    """Return the data with which a page draws a fold on a 2D canvas, and which all frames share.

    The 3D view takes seconds to start on a slow machine and does not work without WebGL. The sketch
    shows the same frame, poses, colours and camera with the browser's 2D canvas.

    Returns:
        JSON of the displayed hull and the field of view: ``corners`` (V, 3) are in pitches,
        ``faces`` lists the corners of each flat face, counterclockwise from outside, ``normals`` is
        (F, 3), and ``field_of_view_rad`` is vertical.
    """
    corners = module.vertices * DISPLAYED_MODULE_SIZE
    faces: list[list[int]] = []
    normals: list[list[float]] = []
    for normal in np.concatenate([module.face_normals, -module.face_normals]):
        reach = corners @ normal
        on = np.flatnonzero(reach > reach.max() - 1e-6)  # rounding
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


def stud_mesh() -> Mesh:
    """Return a low disc along x, for marking the free end of a chain; its base is at the origin."""
    turn = np.linspace(0.0, 2 * np.pi, STUD_SIDES, endpoint=False)
    ring = np.column_stack([np.zeros(STUD_SIDES), np.cos(turn), np.sin(turn)])
    low = ring * STUD_RADIUS
    high = ring * STUD_RADIUS * 0.86 + np.array([0.09, 0.0, 0.0])
    return hull_mesh(np.concatenate([low, high]))


def stud_poses(module: Module, positions: Array, wxyzs: Array) -> tuple[Array, Array]:
    """Return the poses of studs on the free faces: behind the first module, before the last one.

    Args:
        module: Kind of the modules.
        positions: (2, 3) centres of the first and of the last module, pitches.
        wxyzs: (2, 4) orientations of these modules.

    Returns:
        (2, 3) positions and (2, 3, 3) orientations.
    """
    reach = DISPLAYED_MODULE_SIZE * float(np.abs(module.vertices[:, 0]).max())
    half_turn = np.diag([-1.0, -1.0, 1.0])
    turns = matrix_from_wxyz(wxyzs) @ np.array([half_turn, np.eye(3)])
    return positions + reach * turns[..., 0], turns


def _around(corners: Array, normal: Array) -> NDArray[np.int64]:
    """Return the order of a flat face's corners, counterclockwise about its outward normal."""
    spread = corners - corners.mean(axis=0)
    right = spread[0] / np.linalg.norm(spread[0])
    up = np.cross(normal, right)
    return np.argsort(np.arctan2(spread @ up, spread @ right))


def inset(ring: Array) -> Array:
    """Return the corners of a flat face, in order, each moved along its inner bisector."""
    before, after = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(before, after), axis=1, keepdims=True)
    return ring + (before + after) * 0.075 / sine


def hull_mesh(points: Array) -> Mesh:
    """Return the convex hull of points; its triangles are counterclockwise from outside."""
    from scipy.spatial import ConvexHull  # imported late, so that the service starts faster

    hull = ConvexHull(points)
    used = np.unique(hull.simplices)
    index = np.full(len(points), -1)
    index[used] = np.arange(len(used))
    faces = index[hull.simplices]
    vertices = points[used]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(vertices=vertices, faces=faces)
