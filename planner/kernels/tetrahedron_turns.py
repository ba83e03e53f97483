"""Kernels of quarter turns: which hinge of a chain of tetrahedra can turn by 90°, and what follows.

A state of a chain has one level per hinge: −1, 0 or 1 quarter turns. All tetrahedra then lie in
cells of the honeycomb (``planner.chain.honeycomb``), and the honeycomb looks the same from every
hinge. So the smallest distance of two tetrahedra while one turns depends on two cells seen from the
hinge, and is computed once for each such pair.

Cells are stored as the sum of their two nodes: twice their centre.
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, TABLE_FULL, Levels
from foldback.planner.kernels.clearance import pair_separation
from foldback.planner.kernels.module import Hull

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GAP_TOLERANCE: Final = 2e-3
"""Maximum amount, pitches, by which a stored gap is below the smallest distance of a turn."""
MAX_INTERVALS: Final = 64
"""Maximum number of intervals of a turn that wait to be halved: each halving adds one, and the
angle of a turn is at most halved some fifty times before it is no longer a number of its own."""
OCTANT: Final = 1 << 11
"""Offset that makes coordinates of cells as seen from a hinge positive, for keys of the table. The
shorter part of a chain of 1000 modules reaches no farther."""


class TurningGaps(NamedTuple):
    """Hash table of the smallest distances of two cells while one turns by +90° about a hinge.

    Attributes:
        keys: (H,) key of each entry, −1 where there is none; H is a power of two.
        gaps: (H,) smallest distance of each, pitches, at most ``reach``.
        used: (1,) number of entries.
        hull, size: Of the module.
        reach: Distance of neighbouring cells in pitches; larger gaps are not told apart.
    """

    keys: Ints
    gaps: NDArray[np.float32]
    used: Ints
    hull: Hull
    size: float
    reach: float


class Scratch(NamedTuple):
    """Arrays that the kernels use for one state at a time.

    Attributes:
        nodes: (N + 1, 3) nodes of the trail.
        axes: (N, 3) direction of the hinge at the end of each module, one of its coordinates ±1.
        projected: (N, 3) cells as seen from a hinge: along its axis, and across.
        cells: (C,) hash table of the occupied cells: key, or −1.
        modules: (C,) their modules.
        contacts: (N,) number of pairs of touching modules on either side of each hinge.
    """

    nodes: Ints
    axes: Ints
    projected: Ints
    cells: Ints
    modules: NDArray[np.int32]
    contacts: Ints


@njit(**INNER)
def _hinge_axis(x: int, y: int, z: int) -> int:
    """Return the axis of the long edge at a node: its one odd or its one even coordinate."""
    x &= 1
    y &= 1
    z &= 1
    odd = 1 if x + y + z == 1 else 0
    if x == odd:
        return 0
    return 1 if y == odd else 2


@njit(**INNER)
def _write_frame(x: int, y: int, z: int, frame: Array) -> None:
    """Write the orientation of the tetrahedron in a cell whose first coordinate is along a hinge.

    The hinge is at the node (1, 0, 0), along x, so that the cell is (x + 2, y, z).
    """
    along = 0 if x & 1 else (1 if y & 1 else 2)
    nx = (x + 2 - (along == 0)) >> 1
    ny = (y - (along == 1)) >> 1
    nz = (z - (along == 2)) >> 1
    across = _hinge_axis(nx, ny, nz)
    up = 3 - along - across
    frame[:] = 0.0
    frame[along, 0] = 1.0
    frame[across, 1] = 1.0
    frame[up, 2] = 1.0 if (across - along) % 3 == 1 else -1.0


@njit(**INNER)
def _farthest(frame: Array, y: float, z: float, hull: Hull, size: float) -> float:
    """Return the largest distance of a corner from the x axis."""
    farthest = 0.0
    for k in range(hull.vertices.shape[0]):
        v = hull.vertices[k]
        b = y + size * (frame[1, 0] * v[0] + frame[1, 1] * v[1] + frame[1, 2] * v[2])
        c = z + size * (frame[2, 0] * v[0] + frame[2, 1] * v[1] + frame[2, 2] * v[2])
        farthest = max(farthest, b * b + c * c)
    return sqrt(farthest)


@njit(**KERNEL)
def turning_gap(moving: Ints, resting: Ints, hull: Hull, size: float, reach: float) -> float:
    """Return the smallest distance of two tetrahedra while one turns by +90° about a hinge.

    The distance of two bodies changes by at most ρ times the angle, where ρ is the largest distance
    of a corner of either from the hinge's axis: of the one for which it is smaller, as only the
    relative motion counts. Intervals of the angle are halved until that bound decides.

    Args:
        moving, resting: (3,) cells as seen from the hinge, which runs along the first coordinate.
        hull, size: Of the module.
        reach: Distance, pitches, at and above which gaps are not told apart.

    Returns:
        A lower bound of the distance, less than ``GAP_TOLERANCE`` below it, at most ``reach``; 0
        where the tetrahedra meet.
    """
    frame_a = np.zeros((3, 3))
    frame_b = np.zeros((3, 3))
    turned = np.zeros((3, 3))
    gap = np.zeros(3)
    _write_frame(moving[0], moving[1], moving[2], frame_a)
    _write_frame(resting[0], resting[1], resting[2], frame_b)
    ay, az = 0.5 * moving[1], 0.5 * moving[2]
    by, bz = 0.5 * resting[1], 0.5 * resting[2]
    gap[0] = 0.5 * (resting[0] - moving[0])
    rate = min(
        _farthest(frame_a, ay, az, hull, size),
        _farthest(frame_b, by, bz, hull, size),
    )
    middles = np.empty(MAX_INTERVALS)
    halves = np.empty(MAX_INTERVALS)
    middles[0] = 0.25 * pi
    halves[0] = 0.25 * pi
    waiting = 1
    nearest = reach
    while waiting:
        waiting -= 1
        middle, half = middles[waiting], halves[waiting]
        c, s = cos(middle), sin(middle)
        gap[1] = by - (c * ay - s * az)
        gap[2] = bz - (s * ay + c * az)
        distance = (
            sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]) - 2.0 * size * hull.radius
        )
        if distance - rate * half >= nearest:
            continue
        for k in range(3):
            turned[0, k] = frame_a[0, k]
            turned[1, k] = c * frame_a[1, k] - s * frame_a[2, k]
            turned[2, k] = s * frame_a[1, k] + c * frame_a[2, k]
        apart = pair_separation(gap, turned, frame_b, hull, size, nearest + rate * half)
        if apart <= GAP_TOLERANCE:
            return 0.0
        nearest = min(nearest, apart)
        if apart - rate * half < nearest - GAP_TOLERANCE:
            half *= 0.5
            middles[waiting] = middle - half
            halves[waiting] = half
            middles[waiting + 1] = middle + half
            halves[waiting + 1] = half
            waiting += 2
    return max(0.0, nearest - GAP_TOLERANCE) if nearest < reach else reach


@njit(**INNER)
def _write_pair(a: Ints, b: Ints, change: int, pair: Ints) -> None:
    """Write the pair of cells whose turning gap is that of cell a, which turns, and cell b.

    Of the pairs that are alike one is chosen: gaps stay the same when both cells turn about the
    hinge's axis by 90° or are mirrored along it, when the other cell turns back, and when the turn
    is undone.

    Args:
        a, b: (3,) cells as seen from the hinge.
        change: 1 or −1: sign of the turn.
        pair: (2, 3) receives the cell that turns by +90°, and the other one.
    """
    ax, ay, az = a[0], a[1], a[2] * change
    bx, by, bz = b[0], b[1], b[2] * change
    if ay * ay + az * az > by * by + bz * bz:
        ax, ay, az, bx, by, bz = bx, by, -bz, ax, ay, -az
    if ay * by + az * bz < ay * bz - az * by:
        ay, az = -az, -ay
        bz = -bz
    if bx < ax:
        ax, bx = -ax, -bx
    while not (ay > 0 and az >= 0) and (ay != 0 or az != 0):
        ay, az = az, -ay
        by, bz = bz, -by
    pair[0, 0], pair[0, 1], pair[0, 2] = ax, ay, az
    pair[1, 0], pair[1, 1], pair[1, 2] = bx, by, bz


@njit(**INNER)
def _gap_of(pair: Ints, table: TurningGaps) -> float:
    """Return the turning gap of a pair of cells, −1 if the table is full."""
    moving, resting = pair[0], pair[1]
    key = (moving[0] & 3) | ((resting[0] - moving[0]) << 2)
    key |= ((moving[1] + OCTANT) << 6) | ((moving[2] + OCTANT) << 18)
    key |= ((resting[1] + OCTANT) << 30) | ((resting[2] + OCTANT) << 42)
    mask = table.keys.shape[0] - 1
    at = ((key ^ (key >> 29)) * 0x9E3779B97F4A7C1 >> 20) & mask
    while table.keys[at] != key:
        if table.keys[at] < 0:
            if 2 * table.used[0] > mask:
                return -1.0
            table.keys[at] = key
            table.gaps[at] = turning_gap(moving, resting, table.hull, table.size, table.reach)
            table.used[0] += 1
            break
        at = (at + 1) & mask
    return float(table.gaps[at])


@njit(**INNER)
def _place(levels: Levels, state: Scratch) -> None:
    """Compute the nodes and axes of a state."""
    nodes, axes = state.nodes, state.axes
    nodes[0, 0], nodes[0, 1], nodes[0, 2] = 1, 0, 0
    along = (0, 1, 0)
    across = (1, 0, 0)
    for i in range(axes.shape[0]):
        if i > 0:
            level = levels[i - 1]
            if level:
                along, across = (
                    (level * across[0], level * across[1], level * across[2]),
                    (axes[i - 1, 0], axes[i - 1, 1], axes[i - 1, 2]),
                )
            else:
                across = (axes[i - 1, 0], axes[i - 1, 1], axes[i - 1, 2])
        nodes[i + 1, 0] = nodes[i, 0] + along[0]
        nodes[i + 1, 1] = nodes[i, 1] + along[1]
        nodes[i + 1, 2] = nodes[i, 2] + along[2]
        axes[i, 0] = along[1] * across[2] - along[2] * across[1]
        axes[i, 1] = along[2] * across[0] - along[0] * across[2]
        axes[i, 2] = along[0] * across[1] - along[1] * across[0]


@njit(**INNER)
def _cell_key(x: int, y: int, z: int) -> int:
    return ((x + (1 << 15)) << 32) | ((y + (1 << 15)) << 16) | (z + (1 << 15))


@njit(**INNER)
def _slot(state: Scratch, key: int) -> int:
    """Return the place of a cell in the hash table, or the free one where it belongs."""
    mask = state.cells.shape[0] - 1
    at = ((key ^ (key >> 17)) * 0x9E3779B97F4A7C1 >> 20) & mask
    while state.cells[at] != key and state.cells[at] >= 0:
        at = (at + 1) & mask
    return at


@njit(**INNER)
def _fill(state: Scratch) -> bool:
    """Enter the cells of a state; return False if two modules share one."""
    state.cells[:] = -1
    nodes = state.nodes
    for i in range(state.axes.shape[0]):
        key = _cell_key(
            nodes[i, 0] + nodes[i + 1, 0],
            nodes[i, 1] + nodes[i + 1, 1],
            nodes[i, 2] + nodes[i + 1, 2],
        )
        at = _slot(state, key)
        if state.cells[at] == key:
            return False
        state.cells[at] = key
        state.modules[at] = i
    return True


@njit(**INNER)
def _touching(state: Scratch, node: Ints, along: int, side: int) -> int:
    """Return the module in a cell beside one that has a node and an axis, or −1.

    Four cells meet at the long edge of a node. Two of them share a face with the given one.

    Args:
        state: The state.
        node: (3,) the node.
        along: Axis from the node to the cell's centre.
        side: 1 or −1: which of the two.
    """
    across = 3 - along - _hinge_axis(node[0], node[1], node[2])
    key = _cell_key(
        2 * node[0] + side * (across == 0),
        2 * node[1] + side * (across == 1),
        2 * node[2] + side * (across == 2),
    )
    at = _slot(state, key)
    return int(state.modules[at]) if state.cells[at] == key else -1


@njit(**INNER)
def _count_contacts(state: Scratch) -> int:
    """Count touching pairs that are not linked, in all and across each hinge."""
    nodes, across = state.nodes, state.contacts
    across[:] = 0
    total = 0
    for i in range(across.shape[0]):
        along = 0
        for r in range(1, 3):
            if nodes[i + 1, r] != nodes[i, r]:
                along = r
        for end in range(2):
            for side in (-1, 1):
                j = _touching(state, nodes[i + end], along, side)
                if j > i + 1:
                    total += 1
                    across[i] += 1
                    across[j] -= 1
    for k in range(1, across.shape[0]):
        across[k] += across[k - 1]
    return total


@njit(**INNER)
def _see(state: Scratch, hinge: int) -> None:
    """Write all cells as seen from a hinge: along its axis and across it."""
    nodes, projected = state.nodes, state.projected
    axis = 0
    for r in range(1, 3):
        if state.axes[hinge, r]:
            axis = r
    sign = state.axes[hinge, axis]
    v, w = (axis + 1) % 3, (axis + 2) % 3
    at = nodes[hinge + 1]
    for i in range(projected.shape[0]):
        projected[i, 0] = nodes[i, axis] + nodes[i + 1, axis] - 2 * at[axis]
        projected[i, 1] = nodes[i, v] + nodes[i + 1, v] - 2 * at[v]
        projected[i, 2] = sign * (nodes[i, w] + nodes[i + 1, w] - 2 * at[w])


@njit(**INNER)
def _arc_distance(projected: Ints, i: int, j: int, change: int) -> float:
    """Return the distance of the centre of module j from the arc on which that of i turns."""
    ay, az = 0.5 * projected[i, 1], 0.5 * change * projected[i, 2]
    by, bz = 0.5 * projected[j, 1], 0.5 * change * projected[j, 2]
    x = 0.5 * (projected[i, 0] - projected[j, 0])
    along, across = ay * by + az * bz, ay * bz - az * by
    square_sum = ay * ay + az * az + by * by + bz * bz
    if along >= 0.0 and across >= 0.0:  # on the way: no nearer than the difference of the radii
        min_square = square_sum - 2.0 * sqrt(along * along + across * across)
    else:
        min_square = square_sum - 2.0 * max(along, across)  # from the arc's start or its end
    return sqrt(max(0.0, min_square) + x * x)


@njit(**INNER)
def _turns_free(
    state: Scratch, hinge: int, change: int, table: TurningGaps, room: float, pair: Ints
) -> int:
    """Try a turn; return 1 if it is clear, 0 if not, ``TABLE_FULL`` if unknown.

    The modules after the hinge turn by ``change`` · 90°. Pairs are tried from the hinge outwards.
    Neighbours are one pitch apart at most, so that a far module vouches for those next to it.
    """
    projected = state.projected
    diameter = 2.0 * table.hull.radius * table.size + table.reach
    after = 2 * (hinge + 1) >= projected.shape[0]
    steps = projected.shape[0] - hinge - 1 if after else hinge + 1
    to = 1 if after else -1  # direction from the hinge to the shorter part
    first_node, second_node = (hinge + 1, hinge) if after else (hinge, hinge + 1)
    change *= to
    for k in range(steps):
        i = first_node + to * k
        j = second_node - to * (k == 0)
        while 0 <= j < projected.shape[0]:
            spare = _arc_distance(projected, i, j, change) - diameter
            if spare >= 0.0:
                j -= to * (1 + int(spare))
                continue
            _write_pair(projected[i], projected[j], change, pair)
            gap = _gap_of(pair, table)
            if gap < 0.0:
                return TABLE_FULL
            if gap <= room:
                return 0
            j -= to
    return 1


@njit(**INNER)
def _contacts_after(state: Scratch, hinge: int, change: int) -> int:
    """Count pairs on either side of a hinge that touch after a turn and are not linked.

    Returns:
        The number of pairs, or −1 if two modules share a cell.
    """
    nodes = state.nodes
    n = state.axes.shape[0]
    axis = 0
    for r in range(1, 3):
        if state.axes[hinge, r]:
            axis = r
    sign = state.axes[hinge, axis] * change
    v, w = (axis + 1) % 3, (axis + 2) % 3
    centre = nodes[hinge + 1]
    # The shorter part is moved: its modules begin at ``low``, and it turns the other way if it is
    # the one before the hinge.
    far = 2 * (hinge + 1) >= n
    low, high = (hinge + 1, n) if far else (0, hinge + 1)
    if not far:
        sign = -sign
    turned = np.empty((2, 3), np.int64)
    count = 0
    for i in range(low, high):
        for end in range(2):
            node = nodes[i + end]
            turned[end, axis] = node[axis]
            turned[end, v] = centre[v] - sign * (node[w] - centre[w])
            turned[end, w] = centre[w] + sign * (node[v] - centre[v])
        key = _cell_key(
            turned[0, 0] + turned[1, 0], turned[0, 1] + turned[1, 1], turned[0, 2] + turned[1, 2]
        )
        at = _slot(state, key)
        if state.cells[at] == key and (state.modules[at] <= hinge) == far:
            return -1
        along = 0
        for r in range(1, 3):
            if turned[0, r] != turned[1, r]:
                along = r
        for end in range(2):
            for side in (-1, 1):
                j = _touching(state, turned[end], along, side)
                if j >= 0 and (j <= hinge) == far and abs(i - j) > 1:
                    count += 1
    return count


@njit(**KERNEL)
def count_contacts(levels: Levels, scratch: Scratch, contacts: Ints) -> None:
    """Count the touching pairs that are not linked after each turn of a state, clear or not.

    Args:
        levels: (J,) levels of the state.
        scratch: Arrays for the work.
        contacts: (J, 2) receives the number of pairs after each hinge has turned by −90° and by
            90°; −1 where it cannot, or where two modules would be in the same cell.
    """
    contacts[:] = -1
    _place(levels, scratch)
    if not _fill(scratch):
        return
    touching = _count_contacts(scratch)
    for hinge in range(len(levels)):
        for change in (-1, 1):
            if abs(levels[hinge] + change) > 1:
                continue
            after = _contacts_after(scratch, hinge, change)
            if after >= 0:
                after += touching - scratch.contacts[hinge]
            contacts[hinge, (change + 1) // 2] = after


@njit(**KERNEL)
def test_turns(
    levels: Levels,
    hinges: Ints,
    changes: Ints,
    room: float,
    table: TurningGaps,
    scratch: Scratch,
    clear: NDArray[np.bool_],
) -> int:
    """Test which turns of a state are clear.

    Args:
        levels: (J,) levels of the state, in which no two modules share a cell.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room: Distance that modules must keep, pitches.
        table: Turning gaps; missing ones are entered.
        scratch: Arrays for the work.
        clear: (T,) receives True for turns that are clear.

    Returns:
        0, or ``TABLE_FULL``.
    """
    pair = np.zeros((2, 3), np.int64)
    _place(levels, scratch)
    for t in range(len(hinges)):
        _see(scratch, hinges[t])
        free = _turns_free(scratch, hinges[t], changes[t], table, room, pair)
        if free == TABLE_FULL:
            return TABLE_FULL
        clear[t] = free == 1
    return 0


@njit(**KERNEL)
def clear_turns(
    start: Levels,
    hinges: Ints,
    changes: Ints,
    room: float,
    table: TurningGaps,
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
    pair = np.zeros((2, 3), np.int64)
    for t in range(len(hinges)):
        _place(levels, scratch)
        _see(scratch, hinges[t])
        free = _turns_free(scratch, hinges[t], changes[t], table, room, pair)
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
    apart = np.zeros(states.shape[0], np.bool_)
    for s in range(states.shape[0]):
        _place(states[s], scratch)
        apart[s] = _fill(scratch)
    return apart
