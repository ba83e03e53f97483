"""Cells or tetrahedra of a lattice over a cloud of points inside a solid, compiled.

A tetrahedron from the node with the flat index k one step along ``axis`` has the number 3 k + axis.
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import KERNEL, ZERO

Ints = NDArray[np.int64]
Array = NDArray[np.float64]


@njit(**KERNEL)
def count_points(points: Array, stride: int, pitch: float, offset: Array, span: Ints) -> Ints:
    """Count the points in each cell.

    Args:
        points: (p, 3) points; every ``stride``-th counts.
        stride: See above.
        pitch: Edge of a cell.
        offset: (3,) shift: a point x lies in the cell ``floor(x / pitch + offset)``.
        span: (3,) cells along the axes; all points must lie in them.

    Returns:
        (X · Y · Z,) numbers of points.
    """
    counts = np.zeros(span[0] * span[1] * span[2], dtype=np.int64)
    for i in range(0, points.shape[0], stride):
        x = int(points[i, 0] / pitch + offset[0])
        y = int(points[i, 1] / pitch + offset[1])
        z = int(points[i, 2] / pitch + offset[2])
        counts[(x * span[1] + y) * span[2] + z] += 1
    return counts


@njit(**KERNEL)
def count_in_tetrahedra(
    points: Array, stride: int, pitch: float, offset: Array, span: Ints
) -> Ints:
    """Count the points in each tetrahedron.

    A point lies between the nearest node-lattice point with even coordinates and the farthest
    corner of their unit cube; the two axes along which it is farthest from the former tell the
    tetrahedron.

    Args:
        points: (p, 3) points; every ``stride``-th counts.
        stride: See above.
        pitch: Distance of two nodes.
        offset: (3,) shift: a point x has the node coordinates x / pitch + offset, at least 1.
        span: (3,) nodes along the axes; all tetrahedra with points must lie in them.

    Returns:
        (3 · X · Y · Z,) numbers of points.
    """
    counts = np.zeros(3 * span[0] * span[1] * span[2], dtype=np.int64)
    even = np.zeros(3, dtype=np.int64)
    apart = np.zeros(3)
    steps = (span[1] * span[2], span[2], 1)
    for i in range(0, points.shape[0], stride):
        node = ZERO
        for axis in range(3):
            at = points[i, axis] / pitch + offset[axis]
            even[axis] = 2 * int(0.5 * (at + 1.0))
            apart[axis] = at - even[axis]
            node += even[axis] * steps[axis]
        first = 0
        for axis in range(1, 3):
            if abs(apart[axis]) > abs(apart[first]):
                first = axis
        second = 1 if first == 0 else 0
        third = 3 - first - second
        if abs(apart[third]) > abs(apart[second]):
            second = third
        node += steps[first] if apart[first] > 0.0 else -steps[first]
        if apart[second] < 0.0:
            node -= steps[second]
        counts[3 * node + second] += 1
    return counts


@njit(**KERNEL)
def best_overlap(counts: Ints, full: float, total: float, low: int, high: int) -> float:
    """Return the IoU of the best set of cells with a solid, connected or not.

    Args:
        counts: (m,) points of the solid in each cell.
        full: Points in a cell that is wholly inside.
        total: Points in the solid.
        low, high: Smallest and largest number of cells.
    """
    max_count = int(2.0 * full) + 2
    tally = np.zeros(max_count + 1, dtype=np.int64)
    for count in counts:
        if count > 0:
            tally[min(count, max_count)] += 1
    n = ZERO
    shared = 0.0
    best = 0.0
    for count in range(max_count, 0, -1):
        for _ in range(tally[count]):
            n += 1
            if n > high:
                return best
            shared += min(float(count), full)
            if n >= low:
                best = max(best, shared / (total + n * full - shared))
    if n < low:
        best = shared / (total + low * full - shared)
    return best
