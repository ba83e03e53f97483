"""Stable poses of a rigid configuration on a floor.

It rests on a face of the convex hull of all its modules, if its centre of mass is above that face.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array, Flags
from foldback.planner.chain.corners import placed_corners
from foldback.planner.chain.module import Module


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resting:
    """A pose in which a rigid configuration rests on the plane z = 0.

    Attributes:
        turn: (3, 3) rotation of the given configuration into this pose.
        shift: (3,) shift after the rotation, pitches; the centre of mass ends above the origin.
        margin: Distance of the centre of mass from the rim of the face below it, pitches.
    """

    turn: Array
    shift: Array
    margin: float

    def of(self, positions: Array, rotations: Array) -> tuple[Array, Array]:
        """Return the (n, 3) positions and (n, 3, 3) rotations of the modules in this pose."""
        return positions @ self.turn.T + self.shift, self.turn @ rotations


def resting_poses(module: Module, positions: Array, rotations: Array) -> Iterator[Resting]:
    """Yield all poses in which a configuration rests, the one with the lowest centre of mass first.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
    """
    from scipy.spatial import ConvexHull  # takes a while to import

    corners = placed_corners(module, positions, rotations)
    centre = np.average(positions, axis=0, weights=module.masses(len(positions)))
    hull = ConvexHull(corners)
    heights = -(hull.equations[:, :3] @ centre + hull.equations[:, 3])
    below = centre + heights[:, None] * hull.equations[:, :3]
    faces: list[tuple[float, Array]] = []
    for k in np.flatnonzero(_inside(corners[hull.simplices], below)):
        normal = hull.equations[k, :3]
        if not any(normal @ normal_2 > 1.0 - 1e-9 for _, normal_2 in faces):
            faces.append((float(heights[k]), normal))
    for height, normal in sorted(faces, key=lambda face: face[0]):
        turn = turn_down(normal)
        shift = -turn @ centre + np.array([0.0, 0.0, height])
        yield Resting(turn=turn, shift=shift, margin=_margin(hull, normal, centre))


def turn_down(normal: Array) -> Array:
    """Return the (3, 3) smallest rotation that makes a unit vector point down."""
    x, y, z = normal
    if z > 1.0 - 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    across = np.array([-y, x, 0.0])  # normal × down
    cross = np.array([[0.0, 0.0, across[1]], [0.0, 0.0, -across[0]], [-across[1], across[0], 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 - z)


def _inside(triangles: Array, points: Array) -> Flags:
    """Return (S,) flags: (S, 3) points, each in the plane of an (S, 3, 3) triangle, lie in it."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normals = np.cross(b - a, c - a)
    squares = (normals**2).sum(axis=1)
    shares = [
        (np.cross(q - p, points - p) * normals).sum(axis=1) / np.maximum(squares, 1e-20)
        for p, q in ((a, b), (b, c), (c, a))
    ]
    return (np.min(shares, axis=0) >= -1e-9) & (squares > 1e-20)  # rounding


def _margin(hull: object, normal: Array, centre: Array) -> float:
    """Return the distance of a point from the rim of the hull's face with this normal."""
    simplices, equations = hull.simplices, hull.equations  # type: ignore[attr-defined]
    points, neighbours = hull.points, hull.neighbors  # type: ignore[attr-defined]
    min_distance = np.inf
    down = equations[:, :3] @ normal > 1.0 - 1e-9
    for k in np.flatnonzero(down):
        for m in range(3):
            if not down[neighbours[k, m]]:  # the edge opposite corner m is on the rim
                p, q = points[np.delete(simplices[k], m)]
                along = (q - p) / np.linalg.norm(q - p)
                to_edge = (centre - p) - ((centre - p) @ along) * along
                min_distance = min(
                    min_distance, float(np.linalg.norm(to_edge - (to_edge @ normal) * normal))
                )
    return min_distance
