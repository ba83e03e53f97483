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

from planner.kernels.clearance import pair_separation

Array = NDArray[np.float64]
Grid = NDArray[np.int32]
Ints = NDArray[np.int64]
FIXED = 2
"""Modules at the start of a window that belong to the core."""


@njit(cache=True)
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


@njit(cache=True)
def _to_core(
    point: Array,
    rotation: Array,
    number: int,
    last: int,
    grid: Grid,
    low: Ints,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    size: float,
    best: float,
) -> tuple[float, int]:
    """The least separation of one module from the core's cells, if below ``best``, and the cell."""
    found = -1
    gap = np.empty(3)
    still = np.eye(3)
    cx = int(np.round(point[0])) - low[0]
    cy = int(np.round(point[1])) - low[1]
    cz = int(np.round(point[2])) - low[2]
    if (
        cx < -2
        or cy < -2
        or cz < -2
        or cx > grid.shape[0] + 1
        or cy > grid.shape[1] + 1
        or cz > grid.shape[2] + 1
    ):
        return best, found
    for x in range(max(cx - 2, 0), min(cx + 3, grid.shape[0])):
        gap[0] = x + low[0] - point[0]
        for y in range(max(cy - 2, 0), min(cy + 3, grid.shape[1])):
            gap[1] = y + low[1] - point[1]
            for z in range(max(cz - 2, 0), min(cz + 3, grid.shape[2])):
                there = grid[x, y, z]
                if there < 0 or there > last or number - there < 2:
                    continue
                gap[2] = z + low[2] - point[2]
                distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
                if distance - 2.0 * radius * size >= best:
                    continue
                separation = pair_separation(
                    gap, rotation, still, vertices, normals, edges, size, best
                )
                if separation < best:
                    best = separation
                    found = there
    return best, found


@njit(cache=True)
def window_clearance(
    positions: Array,
    rotations: Array,
    first: int,
    rod: int,
    grid: Grid,
    low: Ints,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    size: float,
    enough: float,
) -> tuple[float, int, int]:
    """The least separation of window, rod and core, and the two modules that have it.

    Args:
        positions: (m, 3) centres of the window's modules, in cells.
        rotations: (m, 3, 3) their orientations.
        first: Number of the window's first module in the chain.
        rod: Modules of the rod.
        grid: (X, Y, Z) number of the module in each cell when folded, −1 for none.
        low: (3,) the cell that the grid begins with.
        vertices, normals, edges, radius: The module's hull.
        size: Its scale.
        enough: Separations of this and more are not told apart; at most 0.3.
    """
    count = positions.shape[0]
    last = first + FIXED - 1
    best = enough
    one = -1
    other = -1
    gap = np.empty(3)
    reach = 2.0 * radius * size
    for k in range(FIXED, count):
        best, found = _to_core(
            positions[k],
            rotations[k],
            first + k,
            last,
            grid,
            low,
            vertices,
            normals,
            edges,
            radius,
            size,
            best,
        )
        if found >= 0:
            one = found
            other = first + k
    for i in range(FIXED, count):
        j = i + 2
        while j < count:
            for r in range(3):
                gap[r] = positions[j, r] - positions[i, r]
            distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
            if distance - reach < best:
                separation = pair_separation(
                    gap, rotations[i], rotations[j], vertices, normals, edges, size, best
                )
                if separation < best:
                    best = separation
                    one = first + i
                    other = first + j
                j += 1
            else:
                # Consecutive centres are at most 1 apart.
                j += max(1, int(np.floor(distance - reach - best)))
    if rod == 0:
        return best, one, other
    end = positions[count - 1]
    turn = rotations[count - 1]
    along = turn[:, 0].copy()
    point = np.empty(3)
    corner_low = np.empty(3)
    corner_high = np.empty(3)
    for r in range(3):
        corner_low[r] = low[r] - 2.0
        corner_high[r] = low[r] + grid.shape[r] + 1.0
    a, b = rod_span(end, along, rod, corner_low, corner_high)
    for k in range(a, b):
        for r in range(3):
            point[r] = end[r] + k * along[r]
        best, found = _to_core(
            point,
            turn,
            first + count - 1 + k,
            last,
            grid,
            low,
            vertices,
            normals,
            edges,
            radius,
            size,
            best,
        )
        if found >= 0:
            one = found
            other = first + count - 1 + k
    for i in range(FIXED, count - 1):
        t = 0.0
        for r in range(3):
            t += (positions[i, r] - end[r]) * along[r]
        for k in range(max(1, int(np.floor(t)) - 1), min(rod, int(np.ceil(t)) + 1) + 1):
            for r in range(3):
                gap[r] = end[r] + k * along[r] - positions[i, r]
            distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
            if distance - reach >= best:
                continue
            separation = pair_separation(
                gap, rotations[i], turn, vertices, normals, edges, size, best
            )
            if separation < best:
                best = separation
                one = first + i
                other = first + count - 1 + k
    return best, one, other


@njit(cache=True)
def box_cover(grid: Grid, last: int, out: Ints) -> int:
    """Covers the cells with numbers 0 to ``last`` with boxes, greedily; how many there are.

    Args:
        grid: See ``window_clearance``.
        last: Largest number of a module that is covered.
        out: (B, 6) written: least cell and size of each box; B is enough for all.
    """
    sx, sy, sz = grid.shape
    done = np.zeros(grid.shape, dtype=np.bool_)
    count = 0
    for x in range(sx):
        for y in range(sy):
            for z in range(sz):
                if done[x, y, z] or grid[x, y, z] < 0 or grid[x, y, z] > last:
                    continue
                c = z + 1
                while c < sz and not done[x, y, c] and 0 <= grid[x, y, c] <= last:
                    c += 1
                b = y + 1
                while b < sy:
                    good = True
                    for k in range(z, c):
                        if done[x, b, k] or grid[x, b, k] < 0 or grid[x, b, k] > last:
                            good = False
                            break
                    if not good:
                        break
                    b += 1
                a = x + 1
                while a < sx:
                    good = True
                    for j in range(y, b):
                        for k in range(z, c):
                            if done[a, j, k] or grid[a, j, k] < 0 or grid[a, j, k] > last:
                                good = False
                                break
                        if not good:
                            break
                    if not good:
                        break
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
