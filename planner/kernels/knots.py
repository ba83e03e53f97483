"""Simplification of closed polygons in space without a change of their knot, and their diagrams.

Compiled. A vertex may be removed if no other edge meets the triangle of it and its neighbours
(Koniaris and Muthukumar 1991, Taylor 2000). A case that rounding makes uncertain counts as meeting:
a step is left out rather than done wrongly.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.kinematics import copy_vector

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EDGES_PER_BOX = 24
"""Number of consecutive edges of a closed polygon in one bounding box, by which edges far from a
triangle are skipped."""


@njit(**INNER)
def _volume(a: Array, b: Array, c: Array, d: Array) -> float:
    """Return six times the signed volume of a tetrahedron."""
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    return ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)


@njit(**INNER)
def _meets(p: Array, q: Array, a: Array, b: Array, c: Array) -> bool:
    """Return True if edge pq meets triangle abc, or if rounding makes it uncertain."""
    extent = 0.0
    for k in range(3):
        low = min(min(p[k], q[k]), min(a[k], min(b[k], c[k])))
        high = max(max(p[k], q[k]), max(a[k], max(b[k], c[k])))
        extent = max(extent, high - low)
    # within it rounding may decide the sign, and both count as meeting
    tolerance = 1e-13 * extent * extent * extent
    above = _volume(a, b, c, p)
    below = _volume(a, b, c, q)
    if (above > tolerance and below > tolerance) or (above < -tolerance and below < -tolerance):
        return False
    u = _volume(p, q, a, b)
    v = _volume(p, q, b, c)
    w = _volume(p, q, c, a)
    return (u >= -tolerance and v >= -tolerance and w >= -tolerance) or (
        u <= tolerance and v <= tolerance and w <= tolerance
    )


@njit(**INNER)
def _boxes(points: Array) -> Array:
    """Return (B, 2, 3) bounding boxes of runs of ``EDGES_PER_BOX`` edges of a closed polygon."""
    n = points.shape[0]
    count = (n + EDGES_PER_BOX - 1) // EDGES_PER_BOX
    boxes = np.empty((count, 2, 3))
    for box in range(count):
        first = box * EDGES_PER_BOX
        last = min(n, first + EDGES_PER_BOX)
        for k in range(3):
            low = points[last % n, k]
            high = low
            for i in range(first, last):
                low = min(low, points[i, k])
                high = max(high, points[i, k])
            boxes[box, 0, k] = low
            boxes[box, 1, k] = high
    return boxes


@njit(**INNER)
def _is_unobstructed(
    points: Array,
    following: Ints,
    boxes: Array,
    triangle: Array,
    first: int,
    second: int,
) -> bool:
    """Return True if no edge meets a triangle, other than those that start at two vertices.

    An edge that begins or ends in a corner of the triangle meets it there alone.

    Args:
        points: (n, 3) vertices of the polygon.
        following: (n,) next vertex of each one; −1 for those removed.
        boxes: (B, 2, 3) bounding boxes of its edges.
        triangle: (3, 3) corners.
        first, second: The two vertices.
    """
    low = np.empty(3)
    high = np.empty(3)
    for k in range(3):
        low[k] = min(triangle[0, k], min(triangle[1, k], triangle[2, k]))
        high[k] = max(triangle[0, k], max(triangle[1, k], triangle[2, k]))
    last = following[second]
    n = points.shape[0]
    for box in range(boxes.shape[0]):
        is_separate = False
        for k in range(3):
            if boxes[box, 0, k] > high[k] or boxes[box, 1, k] < low[k]:
                is_separate = True
        if is_separate:
            continue
        for s in range(box * EDGES_PER_BOX, min(n, (box + 1) * EDGES_PER_BOX)):
            e = following[s]
            if e < 0 or e == first or s in (first, second, last):
                continue
            is_separate = False
            for k in range(3):
                if (points[s, k] > high[k] and points[e, k] > high[k]) or (
                    points[s, k] < low[k] and points[e, k] < low[k]
                ):
                    is_separate = True
                    break
            if not is_separate and _meets(
                points[s], points[e], triangle[0], triangle[1], triangle[2]
            ):
                return False
    return True


@njit(**INNER)
def _remaining_vertices(points: Array, following: Ints) -> Array:
    """Return the vertices that were not removed, in order."""
    remaining = np.empty_like(points)
    count = 0
    for i in range(points.shape[0]):
        if following[i] >= 0:
            copy_vector(points[i], remaining[count])
            count += 1
    return remaining[:count].copy()


@njit(**INNER)
def _remove_vertices(points: Array) -> Array:
    """Return a closed polygon without the vertices that can be removed in one round."""
    n = points.shape[0]
    following = np.empty(n, dtype=np.int64)
    for i in range(n):
        following[i] = (i + 1) % n
    boxes = _boxes(points)
    triangle = np.empty((3, 3))
    remaining = n
    before = n - 1
    # The vertex before the first one stays: the round ends at an edge that is still there.
    for i in range(n - 1):
        if remaining <= 3:
            break
        after = following[i]
        copy_vector(points[before], triangle[0])
        copy_vector(points[i], triangle[1])
        copy_vector(points[after], triangle[2])
        if _is_unobstructed(points, following, boxes, triangle, before, i):
            following[before] = after
            following[i] = -1
            remaining -= 1
            # The new edge belongs to the box of its first vertex, which has to contain it.
            box = before // EDGES_PER_BOX
            for k in range(3):
                boxes[box, 0, k] = min(boxes[box, 0, k], points[after, k])
                boxes[box, 1, k] = max(boxes[box, 1, k], points[after, k])
        else:
            before = i
    return _remaining_vertices(points, following)


@njit(**KERNEL)
def simplified(polygon: Array) -> Array:
    """Return a closed polygon (n, 3) without all vertices that its knot does not need."""
    points = polygon.copy()
    while points.shape[0] > 3:
        # Each round starts elsewhere, so that every vertex is tried.
        shorter = _remove_vertices(np.roll(points, 3 * (points.shape[0] // 7 + 1)))
        if shorter.shape[0] == points.shape[0]:
            break
        points = shorter
    return points


@njit(**KERNEL)
def tightened(polygon: Array, pull: float) -> Array:
    """Return a closed polygon with each vertex moved towards the middle of its neighbours.

    A vertex stays where an edge is in the way, so that the knot does.

    Args:
        polygon: (n, 3) vertices.
        pull: Fraction of the way, 0 to 1; one half or one quarter of it is tried next.
    """
    points = polygon.copy()
    n = points.shape[0]
    following = np.empty(n, dtype=np.int64)
    for i in range(n):
        following[i] = (i + 1) % n
    swept_before = np.empty((3, 3))
    swept_after = np.empty((3, 3))
    for i in range(n):
        before = (i - 1) % n
        after = (i + 1) % n
        boxes = _boxes(points)
        fraction = pull
        for _ in range(3):
            moved = points[i] + fraction * (0.5 * (points[before] + points[after]) - points[i])
            copy_vector(points[before], swept_before[0])
            copy_vector(points[i], swept_before[1])
            copy_vector(moved, swept_before[2])
            copy_vector(points[after], swept_after[0])
            copy_vector(points[i], swept_after[1])
            copy_vector(moved, swept_after[2])
            # First the edge before turns about its start, then the one after about its end.
            if _is_unobstructed(
                points, following, boxes, swept_before, before, i
            ) and _is_unobstructed(points, following, boxes, swept_after, before, i):
                copy_vector(moved, points[i])
                break
            fraction *= 0.5
    return points


@njit(**KERNEL)
def crossings(points: Array) -> tuple[Array, Ints]:
    """Return the crossings of a closed polygon (n, 3) in its projection along z.

    Returns:
        (c, 2) parameters of the upper and the lower strand, as edge plus fraction, and (c,) signs.
    """
    n = points.shape[0]
    parameters = np.empty((16, 2))
    signs = np.empty(16, dtype=np.int64)
    count = 0
    for i in range(n):
        a = points[i]
        b = points[(i + 1) % n]
        for j in range(i + 2, n):
            if i == 0 and j == n - 1:
                continue
            c = points[j]
            d = points[(j + 1) % n]
            ux, uy = b[0] - a[0], b[1] - a[1]
            vx, vy = d[0] - c[0], d[1] - c[1]
            across = ux * vy - uy * vx
            if across == 0.0:
                continue
            wx, wy = c[0] - a[0], c[1] - a[1]
            s = (wx * vy - wy * vx) / across
            t = (wx * uy - wy * ux) / across
            if s < 0.0 or s >= 1.0 or t < 0.0 or t >= 1.0:
                continue
            if count == signs.shape[0]:
                enlarged = np.empty((2 * count, 2))
                enlarged[:count] = parameters
                parameters = enlarged
                longer = np.empty(2 * count, dtype=np.int64)
                longer[:count] = signs
                signs = longer
            first_above = a[2] + s * (b[2] - a[2]) > c[2] + t * (d[2] - c[2])
            parameters[count, 0] = i + s if first_above else j + t
            parameters[count, 1] = j + t if first_above else i + s
            signs[count] = 1 if (across > 0.0) == first_above else -1
            count += 1
    return parameters[:count].copy(), signs[:count].copy()


@njit(**KERNEL)
def determinant(matrix: Ints, prime: int) -> int:
    """Return the determinant of a square matrix of integers modulo a prime below 2^31."""
    rows = matrix % prime
    n = rows.shape[0]
    value = 1
    for k in range(n):
        pivot = k
        while pivot < n and rows[pivot, k] == 0:
            pivot += 1
        if pivot == n:
            return 0
        if pivot != k:
            for j in range(n):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
            value = prime - value
        value = value * rows[k, k] % prime
        inverse = 1
        base = rows[k, k]
        power = prime - 2
        while power > 0:
            if power & 1:
                inverse = inverse * base % prime
            base = base * base % prime
            power >>= 1
        for i in range(k + 1, n):
            if rows[i, k] != 0:
                factor = rows[i, k] * inverse % prime
                for j in range(k, n):
                    rows[i, j] = (rows[i, j] - factor * rows[k, j]) % prime
    return value
