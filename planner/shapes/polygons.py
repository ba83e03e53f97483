"""Polygons of meshes, cut into triangles."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Ints

MIN_CORNERS: Final = 3
"""Minimum number of corners of a polygon; one with fewer is a point or a line."""


def skipped_note(count: int) -> tuple[str, ...]:
    """Return the note about polygons of one or two corners; none if there are none."""
    if not count:
        return ()
    polygons = "1 polygon" if count == 1 else f"{count} polygons"
    was = "was" if count == 1 else "were"
    return (f"{polygons} with fewer than {MIN_CORNERS} corners {was} ignored.",)


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
