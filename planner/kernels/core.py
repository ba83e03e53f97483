"""A window of moving modules beside a folded core, and a straight rod at its end, compiled.

The core lies on the cubic lattice: an integer grid tells which module is in which cell. Of a chain
whose modules up to ``last`` are still folded, the core are all cells with a number up to ``last``.
The window are modules ``first``, ``first`` + 1, …; its first two are folded and belong to the core.
The rod are the modules behind the window's last one, in one line with it.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL

Array = NDArray[np.float64]
Grid = NDArray[np.int32]
Ints = NDArray[np.int64]
Covered = NDArray[np.bool_]
FIXED = 2
"""Modules at the start of a window that belong to the core."""


@njit(**INNER)
def rod_span(end: Array, along: Array, rod: int, low: Array, high: Array) -> tuple[int, int]:
    """The modules a … b − 1 of a rod (from 1 on) whose centres lie in a box."""
    a = 1.0
    b = float(rod)
    for r in range(3):
        if abs(along[r]) < 1e-12:
            if end[r] < low[r] or end[r] > high[r]:
                return 1, 1
            continue
        s = (low[r] - end[r]) / along[r]
        t = (high[r] - end[r]) / along[r]
        a = max(a, min(s, t))
        b = min(b, max(s, t))
    if a > b:
        return 1, 1
    return int(np.ceil(a)), int(np.floor(b)) + 1


@njit(**INNER)
def _uncovered(
    grid: Grid, done: Covered, last: int, x: int, y: int, y_end: int, z: int, z_end: int
) -> bool:
    """Whether all cells of a rectangle in one layer hold numbers 0 to ``last`` and no box yet."""
    for j in range(y, y_end):
        for k in range(z, z_end):
            if done[x, j, k] or grid[x, j, k] < 0 or grid[x, j, k] > last:
                return False
    return True


@njit(**KERNEL)
def box_cover(grid: Grid, last: int, out: Ints) -> int:
    """Covers the cells with numbers 0 to ``last`` with boxes, greedily; how many there are.

    Args:
        grid: The number of the module in each cell; negative in an empty one.
        last: Largest number of a module that is covered.
        out: (B, 6) written: least cell and size of each box; B is enough for all.
    """
    sx, sy, sz = grid.shape
    done = np.zeros(grid.shape, dtype=np.bool_)
    count = 0
    for x in range(sx):
        for y in range(sy):
            for z in range(sz):
                if not _uncovered(grid, done, last, x, y, y + 1, z, z + 1):
                    continue
                c = z + 1
                while c < sz and _uncovered(grid, done, last, x, y, y + 1, c, c + 1):
                    c += 1
                b = y + 1
                while b < sy and _uncovered(grid, done, last, x, b, b + 1, z, c):
                    b += 1
                a = x + 1
                while a < sx and _uncovered(grid, done, last, a, y, b, z, c):
                    a += 1
                done[x:a, y:b, z:c] = True
                out[count, 0] = x
                out[count, 1] = y
                out[count, 2] = z
                out[count, 3] = a - x
                out[count, 4] = b - y
                out[count, 5] = c - z
                count += 1
    return count


@njit(**KERNEL)
def distances_at(field: Array, low: Array, points: Array, out: Array) -> None:
    """Writes the (k,) distances of (k, 3) points to what a field is of, roughly.

    Args:
        field: (X, Y, Z) distance of each cell, whose centres are whole numbers apart.
        low: (3,) centre of the first one.
        points: Where to look; outside the field the way to it is added.
        out: Where to write.
    """
    at = np.empty(3, dtype=np.int64)
    for i in range(points.shape[0]):
        beyond = 0.0
        for r in range(3):
            place = points[i, r] - low[r]
            inside = min(max(place, 0.0), field.shape[r] - 1.0)
            at[r] = int(np.rint(inside))
            beyond += (place - inside) ** 2
        out[i] = field[at[0], at[1], at[2]] + np.sqrt(beyond)
