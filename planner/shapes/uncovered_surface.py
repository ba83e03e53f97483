"""Uncovered surface: the parts of a solid's surface that have no module behind them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from planner.arrays import Array, Flags, Ints

DEPTH_PITCH: Final = 0.25
"""Depth below the surface at which a module must be, in pitches, for the surface to count as
covered."""
MAX_EDGE_PITCH: Final = 0.5
"""Length to which edges of large triangles are halved before each triangle is judged, pitches."""
MAX_SPLIT_TRIANGLES: Final = 60_000
"""Number of triangles from which no more are halved."""
LIFT_PITCH: Final = 0.01
"""Distance by which the result is lifted off the surface, in pitches, so that it is drawn in front
of it."""


def uncovered_surface(
    vertices: Array, faces: Ints, is_covered: Callable[[Array], Flags], *, oriented: bool
) -> Array:
    """Return the (T, 3, 3) triangles of a surface that have no module behind them.

    Args:
        vertices: (V, 3) in the space of the folded modules.
        faces: (F, 3) rows of ``vertices``.
        is_covered: Returns which of (P, 3) points are in a module.
        oriented: True if the triangles face outwards; else both of their sides may be inside.
    """
    triangles = _split(vertices[faces])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    middles = triangles.mean(axis=1)
    covered = is_covered(middles - DEPTH_PITCH * normals)
    if not oriented:
        covered |= is_covered(middles + DEPTH_PITCH * normals)
    return triangles[~covered] + LIFT_PITCH * normals[~covered, None]


def _split(triangles: Array) -> Array:
    """Return (T, 3, 3) triangles with their long edges halved, as far as there is room."""
    while len(triangles) < MAX_SPLIT_TRIANGLES:
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = edges.argmax(axis=1)
        long = edges[np.arange(len(edges)), longest] > MAX_EDGE_PITCH
        if not long.any():
            break
        # The longest edge runs from corner 0 to 1 of the rolled triangles.
        rolled = (longest[long, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[long], rolled[..., None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles = np.concatenate([triangles[~long], *halves])
    return triangles
