"""Invariants of a closed polygon's knot, computed apart from ``planner.pathfinding.knots``.

A vertex is left out where no other edge meets the triangle of it and its neighbours, which is an
isotopy. The Alexander polynomial of a projection of the remaining polygon is evaluated at integers,
by elimination without fractions (Bareiss 1968), in integers of any size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array

TRIANGLE_MARGIN: Final = 1e-9
"""Margin around a triangle, as a fraction of its sides, within which an edge counts as crossing it,
so that rounding never hides a crossing when a polygon's vertex is removed."""
Crossings = list[tuple[float, float, int]]
"""Crossings: position of the upper and of the lower strand along the polygon, and sign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Invariants:
    """Invariants of a knot.

    Attributes:
        determinant: |Δ(−1)|; 1 for the unknot.
        at_two: |Δ(2)| without factors of two, in which Δ is not unique; 1 for the unknot.
    """

    determinant: int
    at_two: int

    @property
    def knotted(self) -> bool:
        """True if they prove a knot."""
        return (self.determinant, self.at_two) != (1, 1)


def invariants_of(polygon: Array, rng: np.random.Generator) -> Invariants | None:
    """Return the invariants of a closed polygon's knot; None if it has too many crossings.

    Args:
        polygon: (n, 3) vertices in general position.
        rng: Generator of the projections.
    """
    points = without_idle_vertices(polygon)
    views = (crossings_of(points, sight) for sight in rng.normal(size=(12, 3)))
    return invariants_of_crossings(min(views, key=len))


def invariants_of_crossings(crossings: Crossings) -> Invariants | None:
    """Return the invariants of a diagram; None if it has too many crossings."""
    if len(crossings) > 200:  # elimination takes time by the cube of the number
        return None
    at_two = abs(_alexander(crossings, 2))
    while at_two and at_two % 2 == 0:
        at_two //= 2
    return Invariants(determinant=abs(_alexander(crossings, -1)), at_two=at_two)


def without_idle_vertices(polygon: Array) -> Array:
    """Return a closed polygon (n, 3) without idle vertices; its knot is the same."""
    points = polygon.copy()
    at, idle = 0, 0
    while len(points) > 3 and idle < len(points):
        around = np.roll(points, 1 - at, axis=0)
        # Vertices 0, 1, 2 are the triangle; edges that share a corner meet it there alone.
        if _is_free(around[:3], around[3:-1], around[4:]):
            points, idle = np.delete(points, at, axis=0), 0
            at %= len(points)
        else:
            at, idle = (at + 1) % len(points), idle + 1
    return points


def _is_free(triangle: Array, starts: Array, ends: Array) -> bool:
    """Return True if no edge from (m, 3) points to (m, 3) others meets a triangle (3, 3)."""
    corner, side_1, two = triangle[0], triangle[1] - triangle[0], triangle[2] - triangle[0]
    normal = np.cross(side_1, two)
    from_plane, to_plane = (starts - corner) @ normal, (ends - corner) @ normal
    passes = from_plane * to_plane <= 0.0
    if not passes.any():
        return True
    a, b = from_plane[passes], to_plane[passes]
    share = np.divide(a, a - b, out=np.zeros_like(a), where=a != b)
    offsets = starts[passes] + share[:, None] * (ends - starts)[passes] - corner
    area = max(float(normal @ normal), 1e-300)
    u = np.cross(offsets, two) @ normal / area
    v = np.cross(side_1, offsets) @ normal / area
    return not bool(
        ((u > -TRIANGLE_MARGIN) & (v > -TRIANGLE_MARGIN) & (u + v < 1.0 + TRIANGLE_MARGIN)).any()
    )


def crossings_of(polygon: Array, sight: Array) -> Crossings:
    """Return the crossings of a closed polygon (n, 3) seen against a direction (3,)."""
    up = sight / np.linalg.norm(sight)
    right = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    right /= np.linalg.norm(right)
    projected = polygon @ np.stack([right, np.cross(up, right), up], axis=1)
    edges = np.roll(projected, -1, axis=0) - projected
    n = len(projected)
    crossings: Crossings = []
    for i in range(n - 2):
        later_edges = np.arange(i + 2, n - (i == 0))
        gap, along = projected[later_edges] - projected[i], edges[later_edges]
        across = edges[i, 0] * along[:, 1] - edges[i, 1] * along[:, 0]
        across[across == 0.0] = np.inf
        s = (gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0]) / across
        t = (gap[:, 0] * edges[i, 1] - gap[:, 1] * edges[i, 0]) / across
        hit = np.isfinite(across) & (s >= 0.0) & (s < 1.0) & (t >= 0.0) & (t < 1.0)
        for k in np.flatnonzero(hit).tolist():
            j = int(later_edges[k])
            height_i = float(projected[i, 2] + s[k] * edges[i, 2])
            height_j = float(projected[j, 2] + t[k] * edges[j, 2])
            first, second = i + float(s[k]), j + float(t[k])
            above = height_i > height_j
            sign = 1 if (across[k] > 0.0) == above else -1
            crossings.append((first, second, sign) if above else (second, first, sign))
    return crossings


def _alexander(crossings: Crossings, at: int) -> int:
    """Return Δ of a diagram at an integer, times some power of it."""
    unders = sorted(under for _, under, _ in crossings)
    count = len(unders)
    rows: list[list[int]] = []
    for over, under, sign in crossings:
        row = [0] * count
        arrives = unders.index(under)
        row[int(np.searchsorted(unders, over)) % count] += 1 - at
        row[arrives] += at if sign > 0 else -1
        row[(arrives + 1) % count] += -1 if sign > 0 else at
        rows.append(row)
    return _determinant([row[:-1] for row in rows[:-1]])


def _determinant(rows: list[list[int]]) -> int:
    """Return the determinant of a square matrix of integers; 1 if it is empty."""
    before, sign = 1, 1
    count = len(rows)
    for k in range(count - 1):
        pivot = next((i for i in range(k, count) if rows[i][k]), None)
        if pivot is None:
            return 0
        if pivot != k:
            rows[k], rows[pivot], sign = rows[pivot], rows[k], -sign
        for i in range(k + 1, count):
            for j in range(k + 1, count):
                rows[i][j] = (rows[i][j] * rows[k][k] - rows[i][k] * rows[k][j]) // before
        before = rows[k][k]
    return sign * rows[-1][-1] if count else 1
