"""Polygons of meshes, cut into triangles."""

from __future__ import annotations

import numpy as np

from planner.arrays import Ints


def fans(corners: Ints, counts: Ints) -> Ints:
    """Return the (T, 3) triangles of polygons, each cut into a fan from its first corner.

    Args:
        corners: The polygons' corners, one polygon after the other.
        counts: (P,) corners of each polygon; polygons with fewer than three are left out.
    """
    if len(counts) and (counts == 3).all():
        return corners.reshape(-1, 3)
    starts = np.cumsum(counts) - counts
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(starts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.column_stack([corners[first], corners[first + step + 1], corners[first + step + 2]])
