"""Uncovered surface: the parts of a solid's surface that have no module behind them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints

DEPTH_PITCH: Final = 0.25
"""Depth below the surface at which a module must be, in pitches, for the surface to count as
covered."""
ON_PLANE: Final = 1e-6
"""Distance in units of the planes' spacing below which a corner counts as on a plane."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModuleRegions:
    """Modules as a region of space.

    Attributes:
        is_covered: Returns which of (P, 3) points are in a module.
        normals: (K, 3) normals of the planes in which faces of modules may lie: ``normals @ p +
            offset`` is an integer there.
        offset: See ``normals``.
    """

    is_covered: Callable[[Array], Flags]
    normals: Array
    offset: float


def uncovered_surface(
    vertices: Array, faces: Ints, modules: ModuleRegions, *, oriented: bool
) -> Array:
    """Return the (T, 3, 3) triangles of a surface that have no module behind them.

    They are cut along the faces of modules.

    Args:
        vertices: (V, 3) in the space of the folded modules.
        faces: (F, 3) rows of ``vertices``.
        modules: The modules.
        oriented: True if the triangles face outwards; else both of their sides may be inside.
    """
    triangles = vertices[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    depths = (DEPTH_PITCH,) if oriented else (DEPTH_PITCH, -DEPTH_PITCH)
    for depth in depths:
        below, origin = _cut(triangles - depth * normals[:, None], modules)
        normals = normals[origin]
        triangles = below + depth * normals[:, None]
    middles = triangles.mean(axis=1)
    covered = np.zeros(len(triangles), dtype=np.bool_)
    for depth in depths:
        covered |= modules.is_covered(middles - depth * normals)
    return triangles[~covered] + 0.01 * normals[~covered, None]


def _cut(triangles: Array, modules: ModuleRegions) -> tuple[Array, Ints]:
    """Return (T, 3, 3) pieces of triangles that cross no plane, and (T,) the triangles they are of.

    Winding is preserved.
    """
    origin = np.arange(len(triangles))
    for normal in modules.normals:
        while len(triangles) < 60_000:
            heights = triangles @ normal + modules.offset
            low = np.floor(heights.min(axis=1) + ON_PLANE)
            high = np.ceil(heights.max(axis=1) - ON_PLANE)
            crossed = high - low > 1.5
            if not crossed.any():
                break
            planes = np.floor(0.5 * (low + high))[crossed]
            pieces = _halves(triangles[crossed], heights[crossed] - planes[:, None])
            origin = np.concatenate([origin[~crossed], np.tile(origin[crossed], 3)])
            triangles = np.concatenate([triangles[~crossed], pieces])
            sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            has_area = (sides**2).sum(axis=1) > (2.0 * 1e-9) ** 2  # square pitches
            triangles, origin = triangles[has_area], origin[has_area]
    return triangles, origin


def _halves(triangles: Array, heights: Array) -> Array:
    """Return (3·T, 3, 3) pieces of triangles cut by a plane, three of each; one may have no area.

    Args:
        triangles: (T, 3, 3) triangles that cross the plane.
        heights: (T, 3) signed distances of their corners from it.
    """
    above = heights > 0.0
    lone_above = above.sum(axis=1) == 1
    # The corner that is alone on its side comes first.
    first = np.where(lone_above, above.argmax(axis=1), above.argmin(axis=1))
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, order[..., None], axis=1), 1, 0)
    at_a, at_b, at_c = np.take_along_axis(heights, order, axis=1).T
    p = a + (at_a / (at_a - at_b))[:, None] * (b - a)
    q = a + (at_a / (at_a - at_c))[:, None] * (c - a)
    pieces = ((a, p, q), (p, b, c), (p, c, q))
    return np.concatenate([np.stack(piece, axis=1) for piece in pieces])
