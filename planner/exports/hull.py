"""Hull: the outside of a module as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from planner.chain.module import Module

Array = NDArray[np.float64]


def hull_triangles(module: Module, size: float) -> Array:
    """(T, 3, 3) corners of the hull's triangles, counter-clockwise seen from outside.

    Args:
        module: The kind of module.
        size: Scale about the module's centre; 1 for the full hull, a pitch long.
    """
    hull = ConvexHull(module.vertices)
    triangles = module.vertices[hull.simplices]
    turned = np.einsum("ti,ti->t", normals_of(triangles), hull.equations[:, :3]) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles * size


def normals_of(triangles: Array) -> Array:
    """(T, 3) unit normals of (T, 3, 3) triangles, by their corners' order."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return across / np.linalg.norm(across, axis=1, keepdims=True)
