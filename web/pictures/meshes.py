"""Meshes of modules as they are drawn: a little smaller than the pitch, with bevelled edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.module import Module

Array = NDArray[np.float64]
DISPLAYED_MODULE_SIZE: Final = 0.93
"""Size of a displayed module relative to its true size, so that gaps separate neighbouring modules.
A smaller value widens the gaps. Chosen."""
MODULE_BEVEL: Final = 0.075
"""Width of the bevel along the edges of a displayed module, in pitches. A larger value makes
modules look rounder. Chosen."""
STUD_RADIUS: Final = 0.21
"""Radius of the disc that marks the free end of a displayed chain, in pitches. A larger value makes
the mark easier to see and less like a part of the module. Chosen."""
STUD_HEIGHT: Final = 0.09
"""Height by which the disc that marks the free end of a displayed chain stands out of the module's
face, in pitches. A larger value makes the mark easier to see from the side. Chosen."""
STUD_SIDES: Final = 20
"""Number of sides of the polygon that approximates the disc at the free end of a displayed chain.
More are rounder and slower to draw. Chosen."""
FLAT_TOLERANCE: Final = 1e-6
"""Distance from a plane up to which a corner of a module's mesh lies in this plane, in pitches. A
smaller value splits faces because of rounding errors; a larger one merges different faces.
Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles: ``vertices`` (V, 3) and ``faces`` (F, 3), counterclockwise from outside."""

    vertices: Array
    faces: NDArray[np.int64]


def module_mesh(module: Module) -> Mesh:
    """Return a module's hull, shrunk to leave a gap, with bevelled edges and corners."""
    from scipy.spatial import ConvexHull  # imported late, so that the service starts faster

    corners = module.vertices * DISPLAYED_MODULE_SIZE
    hull = ConvexHull(corners)
    planes = np.unique(np.round(hull.equations, 9), axis=0)
    points = [inset(_ring(corners[_on(corners, plane)])) for plane in planes]
    return hull_mesh(np.concatenate(points))


def stud_mesh() -> Mesh:
    """Return a low disc along x, for marking the free end of a chain; its base is at the origin."""
    turn = np.linspace(0.0, 2 * np.pi, STUD_SIDES, endpoint=False)
    ring = np.column_stack([np.zeros(STUD_SIDES), np.cos(turn), np.sin(turn)])
    low = ring * STUD_RADIUS
    high = ring * STUD_RADIUS * 0.86 + np.array([STUD_HEIGHT, 0.0, 0.0])
    return hull_mesh(np.concatenate([low, high]))


def _on(points: Array, plane: Array) -> NDArray[np.bool_]:
    return np.abs(points @ plane[:3] + plane[3]) < FLAT_TOLERANCE


def _ring(corners: Array) -> Array:
    """Return the corners of one flat face in their order around it."""
    centre = corners.mean(axis=0)
    spread = corners - centre
    _, _, axes = np.linalg.svd(spread)
    flat = spread @ axes[:2].T
    order = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))
    return corners[order]


def inset(ring: Array) -> Array:
    """Return the corners of a flat face, in order, each moved along its inner bisector."""
    before, after = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(before, after), axis=1, keepdims=True)
    return ring + (before + after) * MODULE_BEVEL / sine


def hull_mesh(points: Array) -> Mesh:
    """Return the convex hull of points; its triangles are counterclockwise from outside."""
    from scipy.spatial import ConvexHull  # as above

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
