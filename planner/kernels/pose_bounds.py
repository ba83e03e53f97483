"""Cells of a lattice that is laid over a cloud of points inside a solid, compiled."""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import KERNEL, ZERO

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
def best_overlap(counts: Ints, full: float, total: float, low: int, high: int) -> float:
    """Return the IoU of the best set of cells with a solid, connected or not.

    Args:
        counts: (m,) points of the solid in each cell.
        full: Points in a cell that is wholly inside.
        total: Points in the solid.
        low, high: Smallest and largest number of cells.
    """
    most = int(2.0 * full) + 2
    tally = np.zeros(most + 1, dtype=np.int64)
    for count in counts:
        if count > 0:
            tally[min(count, most)] += 1
    n = ZERO
    shared = 0.0
    best = 0.0
    for count in range(most, 0, -1):
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
