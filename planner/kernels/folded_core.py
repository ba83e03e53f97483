"""Folded core, active window and straight tail of a chain that is peeled, compiled.

The core lies on the cubic lattice: an integer grid holds the index of the module in each cell. If
the modules 0 to ``last`` are still folded, the core consists of all cells with these indices. The
window consists of the modules ``first``, ``first`` + 1, …; its first two are folded and belong to
the core. The tail consists of the modules behind the window's last one, in one line with it.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.kinematics import Vector

Array = NDArray[np.float64]
Grid = NDArray[np.int32]
Ints = NDArray[np.int64]
Covered = NDArray[np.bool_]
FIXED = 2
"""Number of modules at the start of a window (the section of the chain that is simulated) that
still belong to the core (the part that is folded and held): two, as the pose of a joint follows
from the two modules that it links."""


class CoreCells(NamedTuple):
    """Cells of the modules that are still folded, beside a window.

    Attributes:
        grid: (X, Y, Z) index of the module in each cell when folded, −1 for none.
        low: (3,) cell of ``grid[0, 0, 0]``.
        box: (2, 3) smallest and largest cell of the core.
        first: Index of the window's first module in the chain.
    """

    grid: Grid
    low: Ints
    box: Ints
    first: int


@njit(**INNER)
def near_cells(box: Ints, position: Array, reach: int) -> tuple[int, int, int, int, int, int]:
    """Return the first cell of a (2, 3) box within reach, and the one past the last, by axis."""
    x, y, z = int(np.round(position[0])), int(np.round(position[1])), int(np.round(position[2]))
    return (
        max(x - reach, box[0, 0]),
        min(x + reach, box[1, 0]) + 1,
        max(y - reach, box[0, 1]),
        min(y + reach, box[1, 1]) + 1,
        max(z - reach, box[0, 2]),
        min(z + reach, box[1, 2]) + 1,
    )


@njit(**INNER, inline="always")  # called for every cell, it takes most of the time
def is_checked_core_cell(module: int, first: int, k: int) -> bool:
    """Return True if a cell belongs to the core, and is not linked to the window's module k.

    Args:
        module: Index of the module in the cell when folded; negative for none.
        first: Index of the window's first module.
        k: Index of a module in the window.
    """
    return bool(module >= 0 and module < first + FIXED and first + k - module >= 2)


@njit(**INNER)
def tail_span(end: Array, direction: Vector, tail: int, low: Array, high: Array) -> tuple[int, int]:
    """Return the range a … b − 1 of a tail's modules whose centres lie in a box.

    Args:
        end: (3,) centre of the window's last module.
        direction: Unit vector along the tail.
        tail: Number of its modules, which are counted from 1.
        low, high: (3,) corners of the box.
    """
    a = 1.0
    b = float(tail)
    for r in range(3):
        if abs(direction[r]) < 1e-12:  # parallel to both faces
            if end[r] < low[r] or end[r] > high[r]:
                return 1, 1
            continue
        s = (low[r] - end[r]) / direction[r]
        t = (high[r] - end[r]) / direction[r]
        a = max(a, min(s, t))
        b = min(b, max(s, t))
    if a > b:
        return 1, 1
    return int(np.ceil(a)), int(np.floor(b)) + 1


@njit(**INNER)
def _is_uncovered(
    grid: Grid, covered: Covered, last: int, x: int, y: int, y_end: int, z: int, z_end: int
) -> bool:
    """Return True if all cells of a rectangle in a layer hold indices 0 to ``last``, and no box."""
    for j in range(y, y_end):
        for k in range(z, z_end):
            if covered[x, j, k] or grid[x, j, k] < 0 or grid[x, j, k] > last:
                return False
    return True


@njit(**KERNEL)
def box_cover(grid: Grid, last: int, out: Ints) -> int:
    """Cover the cells with indices 0 to ``last`` with boxes, greedily.

    Args:
        grid: (X, Y, Z) index of the module in each cell; negative in an empty one.
        last: Largest index that is covered.
        out: (B, 6) written: smallest cell and size of each box; B is enough for all.

    Returns:
        Number of boxes.
    """
    sx, sy, sz = grid.shape
    covered = np.zeros(grid.shape, dtype=np.bool_)
    count = 0
    for x in range(sx):
        for y in range(sy):
            for z in range(sz):
                if not _is_uncovered(grid, covered, last, x, y, y + 1, z, z + 1):
                    continue
                c = z + 1
                while c < sz and _is_uncovered(grid, covered, last, x, y, y + 1, c, c + 1):
                    c += 1
                b = y + 1
                while b < sy and _is_uncovered(grid, covered, last, x, b, b + 1, z, c):
                    b += 1
                a = x + 1
                while a < sx and _is_uncovered(grid, covered, last, a, y, b, z, c):
                    a += 1
                covered[x:a, y:b, z:c] = True
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
    """Write (k,) approximate distances of points to the cells that a distance field is about.

    Args:
        field: (X, Y, Z) distance of each cell, whose centres are whole numbers apart.
        low: (3,) centre of the first cell.
        points: (k, 3) positions; outside the field, the distance to it is added.
        out: (k,) written.
    """
    cell = np.empty(3, dtype=np.int64)
    for i in range(points.shape[0]):
        beyond = 0.0
        for r in range(3):
            offset = points[i, r] - low[r]
            inside = min(max(offset, 0.0), field.shape[r] - 1.0)
            cell[r] = int(np.rint(inside))
            beyond += (offset - inside) ** 2
        out[i] = field[cell[0], cell[1], cell[2]] + np.sqrt(beyond)
