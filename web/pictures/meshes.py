"""Meshes of modules as they are drawn: a little smaller than the pitch, with bevelled edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.module import Module, Piece
from foldback.planner.chain.polyhedron import Polyhedron
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


def piece_mesh(piece: Piece) -> Mesh:
    """Return a piece's parts, shrunk to leave a gap, with bevelled edges and corners."""
    meshes = [_part_mesh(part) for part in piece.parts]
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate(
            [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        ),
    )


def _part_mesh(part: Polyhedron) -> Mesh:
    corners = part.corners * DISPLAYED_MODULE_SIZE
    return hull_mesh(np.concatenate([inset(corners[list(loop)]) for _, loop in part.faces]))


def sketch_outline(module: Module, modules: int) -> dict[str, Any]:
    """Return the data with which a page draws a fold on a 2D canvas, and which all frames share.

    The 3D view takes seconds to start on a slow machine and does not work without WebGL. The sketch
    shows the same frame, poses, colours and camera with the browser's 2D canvas.

    Returns:
        JSON of the displayed parts and the field of view. ``parts`` have ``corners`` (V, 3) in
        pitches, ``faces``, the corners of each flat face, counterclockwise from outside, and
        ``normals`` (F, 3); ``pieces`` and ``pattern`` are those of ``hull_value``, and
        ``field_of_view_rad`` is vertical.
    """
    return {
        "modules": modules,
        "parts": [
            {
                "corners": (part.corners * DISPLAYED_MODULE_SIZE).tolist(),
                "faces": [list(loop) for _, loop in part.faces],
                "normals": [normal.tolist() for normal, _ in part.faces],
            }
            for part in _parts(module)
        ],
        **_pieces(module),
        "field_of_view_rad": float(FIELD_OF_VIEW_RAD),
    }


def hull_value(module: Module, modules: int, *, unit: float = 1.0) -> dict[str, Any]:
    """Return JSON of the parts of a chain, by which a page finds the module under the pointer.

    Args:
        module: The kind of module.
        modules: Number of modules.
        unit: Length of a pitch.

    Returns:
        ``parts`` have ``face_normals`` and ``vertices``; piece k consists of the parts from
        ``pieces[k][0]`` up to ``pieces[k][1]``, and ``pattern`` lists the pieces of the modules of
        a period.
    """
    return {
        "modules": modules,
        "parts": [
            {
                "face_normals": part.face_normals.tolist(),
                "vertices": (part.corners * unit).tolist(),
            }
            for part in _parts(module)
        ],
        **_pieces(module),
    }


def _parts(module: Module) -> list[Polyhedron]:
    return [part for piece in module.pieces for part in piece.parts]


def _pieces(module: Module) -> dict[str, Any]:
    return {"pieces": module.hull.pieces.tolist(), "pattern": list(module.pattern)}


def stud_mesh() -> Mesh:
    """Return a low disc along x, for marking the free end of a chain; its base is at the origin."""
    turn = np.linspace(0.0, 2 * np.pi, STUD_SIDES, endpoint=False)
    ring = np.column_stack([np.zeros(STUD_SIDES), np.cos(turn), np.sin(turn)])
    low = ring * STUD_RADIUS
    high = ring * STUD_RADIUS * 0.86 + np.array([0.09, 0.0, 0.0])
    return hull_mesh(np.concatenate([low, high]))


def stud_frames(module: Module, modules: int) -> tuple[Array, Array]:
    """Return the places of studs on the free faces of a chain's first and last module.

    A stud lies where the joint would be that the module at the end does not have, on its surface.

    Args:
        module: Kind of the modules.
        modules: Number of modules.

    Returns:
        (2, 3) positions in the frames of these modules, pitches, and (2, 3, 3) axes as columns.
    """
    first, last = module.piece(0), module.piece(modules - 1)
    ends = (
        (first, first.entry, first.entry_axes @ np.diag([-1.0, -1.0, 1.0])),
        (last, last.exit, last.exit_axes),
    )
    positions: list[Array] = []
    for piece, place, axes in ends:
        outward = axes[:, 0]
        height = float((piece.corners @ outward).max())
        positions.append(DISPLAYED_MODULE_SIZE * (place + (height - place @ outward) * outward))
    return np.array(positions), np.array([axes for _, _, axes in ends])


def stud_poses(module: Module, modules: int, positions: Array, wxyzs: Array) -> tuple[Array, Array]:
    """Return the poses of the studs of ``stud_frames``.

    Args:
        module: Kind of the modules.
        modules: Number of modules.
        positions: (2, 3) centres of the first and of the last module, pitches.
        wxyzs: (2, 4) orientations of these modules.

    Returns:
        (2, 3) positions and (2, 3, 3) orientations.
    """
    places, axes = stud_frames(module, modules)
    turns = matrix_from_wxyz(wxyzs)
    return positions + np.einsum("kij,kj->ki", turns, places), turns @ axes


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
