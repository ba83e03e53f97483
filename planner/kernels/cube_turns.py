"""Kernels of quarter turns: which hinge of a chain of cubes can turn by 90°, and what follows.

A state of a chain has one level per hinge: −1, 0 or 1 quarter turns. All cubes then lie in cells of
a lattice. One hinge that turns moves the cubes on one side of it about a lattice axis, so every
cube stays in its layer, and the question whether two cubes meet is one of two squares in a plane.
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, TABLE_FULL, ZERO, Levels

BORDER: Final = 2
"""Number of empty cells on each side of a state in its grid, so that all cells beside one that
touches the state are in the grid."""


class SweptCells(NamedTuple):
    """Table of the cells near the way of a cube that turns by 90° about the origin of its layer.

    Attributes:
        start, stop: (R, R) rows of the cube at offset (a, b), a and b at least 0: entries
            ``start[a, b]`` to ``stop[a, b]``; start is −1 where the row is not computed yet.
        cells: (E, 2) offsets of cells that the cube comes near to.
        gaps: (E,) smallest distance of the cube from each during its turn, pitches.
        used: (1,) number of entries in use.
        half: Half the edge of a cube, pitches.
        reach: Distance up to which cells are entered, pitches.
    """

    start: NDArray[np.int32]
    stop: NDArray[np.int32]
    cells: NDArray[np.int16]
    gaps: NDArray[np.float32]
    used: NDArray[np.int64]
    half: float
    reach: float


@njit(**INNER)
def _distance(x: float, y: float, half: float) -> float:
    """Return the distance of a point from the square of this half edge at the origin."""
    dx = max(abs(x) - half, 0.0)
    dy = max(abs(y) - half, 0.0)
    return sqrt(dx * dx + dy * dy)


@njit(**INNER)
def _arc_gap(px: float, py: float, cx: float, cy: float, half: float) -> float:
    """Return the smallest distance from a square of a point that turns by +90° about the origin.

    The smallest distance from an arc to a square is at an end of the arc, opposite a corner of the
    square, or where the arc is parallel to a side; it is 0 where the arc crosses a side.

    Args:
        px, py: Start of the point.
        cx, cy, half: Centre and half edge of the square, parallel to the axes.
    """
    qx = -py
    qy = px
    gap = min(_distance(px - cx, py - cy, half), _distance(qx - cx, qy - cy, half))
    radius = sqrt(px * px + py * py)
    for k in range(4):
        x = cx + (half if k & 1 else -half)
        y = cy + (half if k & 2 else -half)
        if x * px + y * py >= 0.0 and x * qx + y * qy >= 0.0:
            gap = min(gap, abs(sqrt(x * x + y * y) - radius))
        x = (radius, 0.0, -radius, 0.0)[k]
        y = (0.0, radius, 0.0, -radius)[k]
        if x * px + y * py >= 0.0 and x * qx + y * qy >= 0.0:
            gap = min(gap, _distance(x - cx, y - cy, half))
        # Crossings of the circle with a side, x fixed for two of them and y for the others.
        side = (cx if k < 2 else cy) + (half if k & 1 else -half)
        middle = cy if k < 2 else cx
        if abs(side) < radius:
            half_chord = sqrt(radius * radius - side * side)
            for sign in (-1.0, 1.0):
                across = sign * half_chord
                if abs(across - middle) <= half:
                    x = side if k < 2 else across
                    y = across if k < 2 else side
                    if x * px + y * py >= 0.0 and x * qx + y * qy >= 0.0:
                        return 0.0
    return gap


@njit(**KERNEL)
def turning_gap(a: int, b: int, c: int, d: int, half: float) -> float:
    """Return the smallest distance of two squares while one turns by +90° about the origin.

    Squares that are apart at first come nearest at a corner of one of them. So the distance is that
    of the arcs of the corners of either square, seen from the other one, to that square: exact up
    to rounding errors.

    Args:
        a, b: Centre of the square that turns, with edges parallel to the axes at first.
        c, d: Centre of the square at rest.
        half: Half the edge of both.
    """
    gap = 1e9
    for k in range(4):
        x = half if k & 1 else -half
        y = half if k & 2 else -half
        gap = min(gap, _arc_gap(a + x, b + y, float(c), float(d), half))
        # Seen from the turning square, the other one turns by −90°; mirrored in the x axis, +90°.
        gap = min(gap, _arc_gap(c + x, -(d + y), float(a), float(-b), half))
    return gap


@njit(**INNER)
def _enter_row(table: SweptCells, a: int, b: int) -> bool:
    """Compute a row of the table; return False if there is no room for it."""
    radius = sqrt(float(a * a + b * b))
    margin = 2.0 * sqrt(2.0) * table.half + table.reach
    low = int(radius + margin) + 1
    at = table.used[0]
    first_entry = at
    for c in range(-low, low + 1):
        for d in range(-low, low + 1):
            distance = sqrt(float(c * c + d * d))
            if abs(distance - radius) > margin:
                continue
            # Outside the sector of the turn by more than the margin: too far on either side.
            if a * c + b * d < 0 and -b * c + a * d < 0 and distance > margin:
                continue
            if -b * c + a * d < -margin * radius or a * c + b * d < -margin * radius:
                continue
            gap = turning_gap(a, b, c, d, table.half)
            if gap < table.reach:
                if at >= table.cells.shape[0]:
                    return False
                table.cells[at, 0] = c
                table.cells[at, 1] = d
                table.gaps[at] = gap
                at += 1
    table.used[0] = at
    table.start[a, b] = first_entry
    table.stop[a, b] = at
    return True


class Scratch(NamedTuple):
    """Arrays that the kernels use for one state at a time.

    Attributes:
        cells: (N, 3) cell of each module.
        axes: (N, 3, 3) axes of each module as columns: ``axes[i, :, 0]`` is its x axis.
        grid: (G,) number of the module in each cell of the box around a state, plus 1; else 0.
        contacts: (N,) number of pairs of touching modules on either side of each module's joint.
        nearest, farthest: (N + 2 · ``BORDER``,) smallest and largest distance of the modules at
            rest in each layer from the axis of a turn.
    """

    cells: NDArray[np.int64]
    axes: NDArray[np.int64]
    grid: NDArray[np.int16]
    contacts: NDArray[np.int64]
    nearest: NDArray[np.float64]
    farthest: NDArray[np.float64]


@njit(**INNER)
def _place(levels: Levels, cells: NDArray[np.int64], axes: NDArray[np.int64]) -> None:
    """Compute the cells and axes of all modules of a state."""
    for r in range(3):
        cells[0, r] = 0
        for c in range(3):
            axes[0, r, c] = 1 if r == c else 0
    for i in range(1, cells.shape[0]):
        for r in range(3):
            x = axes[i - 1, r, 0]
            y = axes[i - 1, r, 1]
            z = axes[i - 1, r, 2]
            if i >= 2:
                about_z = levels[2 * (i - 2)]
                about_y = levels[2 * (i - 2) + 1]
                if about_z == 1:
                    x, y = y, -x
                elif about_z == -1:
                    x, y = -y, x
                if about_y == 1:
                    x, z = -z, x
                elif about_y == -1:
                    x, z = z, -x
            axes[i, r, 0] = x
            axes[i, r, 1] = y
            axes[i, r, 2] = z
            cells[i, r] = cells[i - 1, r] + x


@njit(**INNER)
def _measure_layers(state: Scratch, sizes: NDArray[np.int64], turn: NDArray[np.int64]) -> None:
    """Compute the smallest and largest distance from the axis at rest in each layer."""
    k = turn[0]
    u = turn[1]
    v = (u + 1) % 3
    w = (u + 2) % 3
    cells = state.cells
    for layer in range(sizes[u]):
        state.nearest[layer] = 1e9
        state.farthest[layer] = -1e9
    first_layer = ZERO if turn[3] > k else k + 1
    end = k + 1 if turn[3] > k else cells.shape[0]
    for j in range(first_layer, end):
        a = cells[j, v] - cells[k, v]
        b = cells[j, w] - cells[k, w]
        distance = sqrt(float(a * a + b * b))
        layer = cells[j, u]
        state.nearest[layer] = min(state.nearest[layer], distance)
        state.farthest[layer] = max(state.farthest[layer], distance)


@njit(**INNER)
def _turns_free(
    state: Scratch,
    sizes: NDArray[np.int64],
    turn: NDArray[np.int64],
    table: SweptCells,
    room: float,
) -> int:
    """Try a turn of the shorter part; return 1 if it is clear, 0 if not, ``TABLE_FULL`` if unknown.

    Args:
        state: Cells and grid of the state.
        sizes: (3,) sizes of the grid.
        turn: Module of the joint, axis 0 to 2, sign of the turn of the modules after it, the first
            module that moves and the one after the last, and where the smallest distance is stored.
        table: Swept cells.
        room: Distance that all modules must keep, pitches.
    """
    k = turn[0]
    u = turn[1]
    sign = turn[2]
    v = (u + 1) % 3
    w = (u + 2) % 3
    far = turn[3] > k
    cells = state.cells
    strides = (sizes[1] * sizes[2], sizes[2], 1)
    origin_v = cells[k, v]
    origin_w = cells[k, w]
    _measure_layers(state, sizes, turn)
    # Cubes whose centres are at distances from the axis that differ by more never come near.
    margin = 2.0 * sqrt(2.0) * table.half + table.reach
    for n in range(turn[4] - turn[3]):
        i = turn[3] + n if far else turn[4] - 1 - n
        a = cells[i, v] - origin_v
        b = sign * (cells[i, w] - origin_w)
        distance = sqrt(float(a * a + b * b))
        layer = cells[i, u]
        if distance > state.farthest[layer] + margin or distance < state.nearest[layer] - margin:
            continue
        # The row of the table is that of the offset in the first quadrant; q turns lead back to it.
        q = 0
        while not (a > 0 and b >= 0) and not (a == 0 and b == 0):
            a, b = b, -a
            q += 1
        if table.start[a, b] < 0 and not _enter_row(table, a, b):
            return TABLE_FULL
        for e in range(table.start[a, b], table.stop[a, b]):
            c = table.cells[e, 0]
            d = table.cells[e, 1]
            if q & 1:
                c, d = -d, c
            if q & 2:
                c, d = -c, -d
            c += origin_v
            d = origin_w + sign * d
            if c < 0 or d < 0 or c >= sizes[v] or d >= sizes[w]:
                continue
            j = int(state.grid[cells[i, u] * strides[u] + c * strides[v] + d * strides[w]]) - 1
            if j >= 0 and (j <= k) == far and j - i != 1 and i - j != 1 and table.gaps[e] <= room:
                return 0
    return 1


@njit(**INNER)
def _fill(state: Scratch, sizes: NDArray[np.int64]) -> bool:
    """Move the cells of a state into a box and fill its grid; return False if it is too big."""
    cells = state.cells
    for r in range(3):
        low = cells[:, r].min() - BORDER
        for i in range(cells.shape[0]):
            cells[i, r] -= low
        sizes[r] = cells[:, r].max() + 1 + BORDER
    if sizes[0] * sizes[1] * sizes[2] > state.grid.shape[0]:
        return False
    for i in range(cells.shape[0]):
        state.grid[(cells[i, 0] * sizes[1] + cells[i, 1]) * sizes[2] + cells[i, 2]] = i + 1
    return True


@njit(**INNER)
def _clear(state: Scratch, sizes: NDArray[np.int64]) -> None:
    cells = state.cells
    for i in range(cells.shape[0]):
        state.grid[(cells[i, 0] * sizes[1] + cells[i, 1]) * sizes[2] + cells[i, 2]] = 0


@njit(**INNER)
def _count_contacts(state: Scratch, sizes: NDArray[np.int64]) -> int:
    """Count touching pairs that are not linked, in all and across each joint."""
    cells = state.cells
    across = state.contacts
    across[:] = 0
    total = 0
    for i in range(cells.shape[0]):
        at = (cells[i, 0] * sizes[1] + cells[i, 1]) * sizes[2] + cells[i, 2]
        for step in (sizes[1] * sizes[2], sizes[2], 1):
            j = int(state.grid[at + step]) - 1
            if j >= 0 and abs(i - j) > 1:
                total += 1
                # The joint of module k lies between modules k and k + 1.
                across[min(i, j)] += 1
                across[max(i, j)] -= 1
    for k in range(1, cells.shape[0]):
        across[k] += across[k - 1]
    return total


@njit(**INNER)
def _contacts_after(state: Scratch, sizes: NDArray[np.int64], turn: NDArray[np.int64]) -> int:
    """Count pairs of a moved and a resting module that touch after a turn and are not linked.

    Returns:
        The number of pairs, or −1 if two modules share a cell.
    """
    k = turn[0]
    u = turn[1]
    sign = turn[2]
    v = (u + 1) % 3
    w = (u + 2) % 3
    far = turn[3] > k
    cells = state.cells
    strides = (sizes[1] * sizes[2], sizes[2], 1)
    count = 0
    for i in range(turn[3], turn[4]):
        b = cells[k, v] - sign * (cells[i, w] - cells[k, w])
        c = cells[k, w] + sign * (cells[i, v] - cells[k, v])
        if b < 1 or c < 1 or b >= sizes[v] - 1 or c >= sizes[w] - 1:
            continue
        at = cells[i, u] * strides[u] + b * strides[v] + c * strides[w]
        j = int(state.grid[at]) - 1
        if j >= 0 and (j <= k) == far:
            return -1
        for stride in strides:
            for place in (at - stride, at + stride):
                j = int(state.grid[place]) - 1
                if j >= 0 and (j <= k) == far and abs(i - j) > 1:
                    count += 1
    return count


@njit(**INNER)
def _turn_of(
    state: Scratch, levels: Levels, hinge: int, change: int, turn: NDArray[np.int64]
) -> None:
    """Describe the turn of a hinge by one level, as ``_turns_free`` takes it."""
    k = hinge // 2 + 1
    count = state.cells.shape[0]
    column = 2
    sign = change
    if hinge % 2:  # the second hinge turns with the first one
        about_z = levels[hinge - 1]
        column = 1 if about_z == 0 else 0
        if about_z == 1:
            sign = -sign
    axis = 0
    for r in range(3):
        if state.axes[k, r, column] != 0:
            axis = r
            sign *= state.axes[k, r, column]
    turn[0] = k
    turn[1] = axis
    if k + 1 < count - k - 1:  # the modules before the joint are fewer: they turn the other way
        turn[2] = -sign
        turn[3] = 0
        turn[4] = k + 1
    else:
        turn[2] = sign
        turn[3] = k + 1
        turn[4] = count


@njit(**KERNEL)
def count_contacts(levels: Levels, scratch: Scratch, contacts: NDArray[np.int64]) -> None:
    """Count the touching pairs that are not linked after each turn of a state, clear or not.

    Args:
        levels: (J,) levels of the state.
        scratch: Arrays for the work.
        contacts: (J, 2) receives the number of pairs after each hinge has turned by −90° and by
            90°; −1 where it cannot, or where two modules would be in the same cell.
    """
    sizes = np.zeros(3, np.int64)
    turn = np.zeros(5, np.int64)
    contacts[:] = -1
    _place(levels, scratch.cells, scratch.axes)
    if not _fill(scratch, sizes):
        return
    touching = _count_contacts(scratch, sizes)
    for hinge in range(len(levels)):
        for change in (-1, 1):
            if abs(levels[hinge] + change) > 1:
                continue
            _turn_of(scratch, levels, hinge, change, turn)
            after = _contacts_after(scratch, sizes, turn)
            if after >= 0:
                after += touching - scratch.contacts[turn[0]]
            contacts[hinge, (change + 1) // 2] = after
    _clear(scratch, sizes)


@njit(**KERNEL)
def test_turns(
    levels: Levels,
    hinges: NDArray[np.int64],
    changes: NDArray[np.int64],
    room: float,
    table: SweptCells,
    scratch: Scratch,
    clear: NDArray[np.bool_],
) -> int:
    """Test which turns of a state are clear.

    Args:
        levels: (J,) levels of the state, in which no two modules share a cell.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room: Distance that modules must keep, pitches.
        table: Swept cells; missing rows are entered.
        scratch: Arrays for the work.
        clear: (T,) receives True for turns that are clear.

    Returns:
        0, or ``TABLE_FULL``.
    """
    sizes = np.zeros(3, np.int64)
    turn = np.zeros(5, np.int64)
    _place(levels, scratch.cells, scratch.axes)
    _fill(scratch, sizes)
    result = 0
    for t in range(len(hinges)):
        _turn_of(scratch, levels, hinges[t], changes[t], turn)
        free = _turns_free(scratch, sizes, turn, table, room)
        if free == TABLE_FULL:
            result = TABLE_FULL
            break
        clear[t] = free == 1
    _clear(scratch, sizes)
    return result


@njit(**KERNEL)
def clear_turns(
    start: Levels,
    hinges: NDArray[np.int64],
    changes: NDArray[np.int64],
    room: float,
    table: SweptCells,
    scratch: Scratch,
) -> int:
    """Count the turns of a sequence, made one by one from a state on, up to one that is not clear.

    Args:
        start: (J,) levels of the state.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room, table, scratch: As in ``test_turns``.

    Returns:
        Number of turns before the first that is not clear, T if all are; or ``TABLE_FULL``.
    """
    levels = start.copy()
    sizes = np.zeros(3, np.int64)
    turn = np.zeros(5, np.int64)
    for t in range(len(hinges)):
        _place(levels, scratch.cells, scratch.axes)
        if not _fill(scratch, sizes):
            return t
        _turn_of(scratch, levels, hinges[t], changes[t], turn)
        free = _turns_free(scratch, sizes, turn, table, room)
        _clear(scratch, sizes)
        if free == TABLE_FULL:
            return TABLE_FULL
        if free == 0:
            return t
        levels[hinges[t]] += changes[t]
    return len(hinges)


@njit(**KERNEL)
def without_overlaps(states: Levels, scratch: Scratch) -> NDArray[np.bool_]:
    """Return (B,) True for states in which no two modules are in the same cell.

    Args:
        states: (B, J) levels.
        scratch: Arrays for the work.
    """
    apart = np.ones(states.shape[0], np.bool_)
    sizes = np.zeros(3, np.int64)
    for s in range(states.shape[0]):
        _place(states[s], scratch.cells, scratch.axes)
        if not _fill(scratch, sizes):
            apart[s] = False
            continue
        # Of two modules in one cell, only the number of the later one is still there.
        for i in range(scratch.cells.shape[0]):
            cell = scratch.cells[i]
            at = (cell[0] * sizes[1] + cell[1]) * sizes[2] + cell[2]
            if scratch.grid[at] != i + 1:
                apart[s] = False
                break
        _clear(scratch, sizes)
    return apart
