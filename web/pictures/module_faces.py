"""Module faces: the mesh of a module, split by faces, so that each face can be lit separately.

Together they form the mesh of ``web.pictures.meshes``: shrunk to leave a gap, with bevelled edges.
Each is a flat face with half of each bevel around it; normals turn evenly across a bevel, so that
edges look round.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.module import Piece
from foldback.planner.chain.polyhedron import Polyhedron
from foldback.web.pictures.meshes import DISPLAYED_MODULE_SIZE, inset

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnFace:
    """One face of a piece with its part of the bevels.

    Attributes:
        vertices: (V, 3) vertices in the piece's frame, pitches.
        normals: (V, 3) unit normals at the vertices.
        triangles: (T, 3) indices of vertices, counterclockwise from outside.
        middle: (3,) centre of the flat face.
        normal: (3,) unit normal of the flat face.
    """

    vertices: Array
    normals: Array
    triangles: NDArray[np.int64]
    middle: Array
    normal: Array


def drawn_faces(piece: Piece) -> tuple[DrawnFace, ...]:
    """Return the faces of a piece, part by part."""
    return tuple(face for part in piece.parts for face in _faces_of_part(part))


def _faces_of_part(part: Polyhedron) -> list[DrawnFace]:
    corners = part.corners * DISPLAYED_MODULE_SIZE
    faces = [list(loop) for _, loop in part.faces]
    normals: Array = np.array([normal for normal, _ in part.faces])
    drawn: dict[tuple[int, int], Array] = {}
    beside: dict[tuple[int, int], int] = {}
    meeting: dict[int, list[int]] = defaultdict(list)
    for face, ring in enumerate(faces):
        for corner, point in zip(ring, inset(corners[ring]), strict=True):
            drawn[face, corner] = point
            meeting[corner].append(face)
        for corner, following in zip(ring, [*ring[1:], ring[0]], strict=True):
            beside[corner, following] = face

    def shared(corner: int, *owners: int) -> tuple[Array, Array]:
        """Return the point between faces at a corner, and its unit normal."""
        point = np.mean([drawn[face, corner] for face in owners], axis=0)
        normal = normals[list(owners)].sum(axis=0)
        return point, normal / np.linalg.norm(normal)

    result: list[DrawnFace] = []
    for face, ring in enumerate(faces):
        points: list[tuple[Array, Array]] = [shared(corner, face) for corner in ring]
        count = len(ring)
        triangles = [(0, k, k + 1) for k in range(1, count - 1)]
        for k, corner in enumerate(ring):
            before, after = ring[k - 1], ring[(k + 1) % count]
            ahead, behind = beside[after, corner], beside[corner, before]
            at, following = len(points), (k + 1) % count
            # This face's part of the corner, then its half of the bevel to the next corner.
            points += [
                shared(corner, face, behind),
                shared(corner, *meeting[corner]),
                shared(corner, face, ahead),
                shared(after, face, ahead),
            ]
            triangles += [(k, at, at + 1), (k, at + 1, at + 2)]
            triangles += [(k, at + 2, at + 3), (k, at + 3, following)]
        vertices, their_normals = (np.array(values) for values in zip(*points, strict=True))
        result.append(
            DrawnFace(
                vertices=vertices,
                normals=their_normals,
                triangles=np.array(triangles),
                middle=corners[ring].mean(axis=0),
                normal=normals[face],
            )
        )
    return result
