"""Polygons in space made smaller without changing their knot, and their diagrams, compiled.

A vertex may go when no other edge meets the triangle of it and its neighbours (Koniaris and
Muthukumar 1991, Taylor 2000). Whatever cannot be told from rounding counts as meeting, so a step is
left out rather than done wrongly.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.kinematics import copy_vector

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

CHUNK = 24
"""Edges along the polygon in one bounding box."""
ROUNDING = 1e-13
"""Volumes below this many cubes of the extent may be of either sign."""


@njit(**INNER)
def _volume(a: Array, b: Array, c: Array, d: Array) -> float:
    """Six times the signed volume of a tetrahedron."""
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    return ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)


@njit(**INNER)
def _meets(p: Array, q: Array, a: Array, b: Array, c: Array) -> bool:
    """Whether an edge meets a triangle; true as well where rounding hides it."""
    extent = 0.0
    for k in range(3):
        low = min(min(p[k], q[k]), min(a[k], min(b[k], c[k])))
        high = max(max(p[k], q[k]), max(a[k], max(b[k], c[k])))
        extent = max(extent, high - low)
    little = ROUNDING * extent * extent * extent
    above = _volume(a, b, c, p)
    below = _volume(a, b, c, q)
    if (above > little and below > little) or (above < -little and below < -little):
        return False
    u = _volume(p, q, a, b)
    v = _volume(p, q, b, c)
    w = _volume(p, q, c, a)
    return (u >= -little and v >= -little and w >= -little) or (
        u <= little and v <= little and w <= little
    )


@njit(**INNER)
def _boxes(points: Array) -> Array:
    """Bounding boxes (chunks, 2, 3) of runs of edges of a closed polygon."""
    n = points.shape[0]
    count = (n + CHUNK - 1) // CHUNK
    boxes = np.empty((count, 2, 3))
    for chunk in range(count):
        first = chunk * CHUNK
        last = min(n, first + CHUNK)
        for k in range(3):
            low = points[last % n, k]
            high = low
            for i in range(first, last):
                low = min(low, points[i, k])
                high = max(high, points[i, k])
            boxes[chunk, 0, k] = low
            boxes[chunk, 1, k] = high
    return boxes


@njit(**INNER)
def _is_free(
    points: Array,
    following: Whole,
    boxes: Array,
    triangle: Array,
    one: int,
    two: int,
) -> bool:
    """Whether no edge meets a triangle, other than those that start at two vertices.

    An edge that begins or ends in a corner of the triangle meets it there alone.
    """
    low = np.empty(3)
    high = np.empty(3)
    for k in range(3):
        low[k] = min(triangle[0, k], min(triangle[1, k], triangle[2, k]))
        high[k] = max(triangle[0, k], max(triangle[1, k], triangle[2, k]))
    last = following[two]
    n = points.shape[0]
    for chunk in range(boxes.shape[0]):
        apart = False
        for k in range(3):
            if boxes[chunk, 0, k] > high[k] or boxes[chunk, 1, k] < low[k]:
                apart = True
        if apart:
            continue
        for s in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            e = following[s]
            if e < 0 or e == one or s in (one, two, last):
                continue
            apart = False
            for k in range(3):
                if (points[s, k] > high[k] and points[e, k] > high[k]) or (
                    points[s, k] < low[k] and points[e, k] < low[k]
                ):
                    apart = True
                    break
            if not apart and _meets(points[s], points[e], triangle[0], triangle[1], triangle[2]):
                return False
    return True


@njit(**INNER)
def _without(points: Array, following: Whole) -> Array:
    """The vertices that are left, in order."""
    left = np.empty_like(points)
    count = 0
    for i in range(points.shape[0]):
        if following[i] >= 0:
            copy_vector(points[i], left[count])
            count += 1
    return left[:count].copy()


@njit(**INNER)
def _pass(points: Array) -> Array:
    """Goes around a closed polygon once and leaves out the vertices that may go."""
    n = points.shape[0]
    following = np.empty(n, dtype=np.int64)
    for i in range(n):
        following[i] = (i + 1) % n
    boxes = _boxes(points)
    triangle = np.empty((3, 3))
    left = n
    before = n - 1
    # The vertex before the first one stays, so that the round ends where it began.
    for i in range(n - 1):
        if left <= 3:
            break
        after = following[i]
        copy_vector(points[before], triangle[0])
        copy_vector(points[i], triangle[1])
        copy_vector(points[after], triangle[2])
        if _is_free(points, following, boxes, triangle, before, i):
            following[before] = after
            following[i] = -1
            left -= 1
            # The new edge is kept where it starts, and that box has to hold it.
            chunk = before // CHUNK
            for k in range(3):
                boxes[chunk, 0, k] = min(boxes[chunk, 0, k], points[after, k])
                boxes[chunk, 1, k] = max(boxes[chunk, 1, k], points[after, k])
        else:
            before = i
    return _without(points, following)


@njit(**KERNEL)
def reduced(polygon: Array) -> Array:
    """Leaves out vertices of a closed polygon (n, 3) until none may go; its knot stays."""
    points = polygon.copy()
    while points.shape[0] > 3:
        # Starting elsewhere each time gives every vertex its turn.
        fewer = _pass(np.roll(points, 3 * (points.shape[0] // 7 + 1)))
        if fewer.shape[0] == points.shape[0]:
            break
        points = fewer
    return points


@njit(**KERNEL)
def tightened(polygon: Array, pull: float) -> Array:
    """Pulls each vertex towards the middle of its neighbours where nothing is in the way.

    Args:
        polygon: (n, 3) closed.
        pull: How far, from 0 to 1; half, a quarter … of it where that is too far.
    """
    points = polygon.copy()
    n = points.shape[0]
    following = np.empty(n, dtype=np.int64)
    for i in range(n):
        following[i] = (i + 1) % n
    one = np.empty((3, 3))
    other = np.empty((3, 3))
    for i in range(n):
        before = (i - 1) % n
        after = (i + 1) % n
        boxes = _boxes(points)
        part = pull
        for _ in range(3):
            moved = points[i] + part * (0.5 * (points[before] + points[after]) - points[i])
            copy_vector(points[before], one[0])
            copy_vector(points[i], one[1])
            copy_vector(moved, one[2])
            copy_vector(points[after], other[0])
            copy_vector(points[i], other[1])
            copy_vector(moved, other[2])
            # First the edge before swings about its start, then the one after about its end.
            if _is_free(points, following, boxes, one, before, i) and _is_free(
                points, following, boxes, other, before, i
            ):
                copy_vector(moved, points[i])
                break
            part *= 0.5
    return points


@njit(**KERNEL)
def crossings(points: Array) -> tuple[Array, Whole]:
    """Crossings of a closed polygon (n, 3) seen along z.

    Returns:
        (c, 2) where along the polygon the upper and the lower strand cross, as edge plus fraction,
        and (c,) the signs.
    """
    n = points.shape[0]
    places = np.empty((16, 2))
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
                more = np.empty((2 * count, 2))
                more[:count] = places
                places = more
                longer = np.empty(2 * count, dtype=np.int64)
                longer[:count] = signs
                signs = longer
            first_above = a[2] + s * (b[2] - a[2]) > c[2] + t * (d[2] - c[2])
            places[count, 0] = i + s if first_above else j + t
            places[count, 1] = j + t if first_above else i + s
            signs[count] = 1 if (across > 0.0) == first_above else -1
            count += 1
    return places[:count].copy(), signs[:count].copy()


@njit(**KERNEL)
def determinant(matrix: Whole, prime: int) -> int:
    """Determinant of a square matrix of whole numbers modulo a prime below 2^31."""
    rows = matrix % prime
    n = rows.shape[0]
    found = 1
    for k in range(n):
        pivot = k
        while pivot < n and rows[pivot, k] == 0:
            pivot += 1
        if pivot == n:
            return 0
        if pivot != k:
            for j in range(n):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
            found = prime - found
        found = found * rows[k, k] % prime
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
    return found
