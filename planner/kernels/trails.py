"""Kernels for closed trails of tetrahedra: pairings at nodes, and annealing towards a solid.

A set of tetrahedra of the tetragonal disphenoid honeycomb has a closed trail if it is connected by
hinges and an even number of them meets at every node: two or four. Each unit cube of the nodes'
lattice has a ring of six tetrahedra around one of its diagonals. A move of the annealing takes
those tetrahedra of one ring that are in the set out of it, and puts the others in, which leaves the
numbers at all nodes even. Worse sets are accepted as in ``path_annealing``.

The annealing numbers tetrahedra by their lower node and axis: that from the node with the flat
index k one step along ``axis`` is 3 k + axis.
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO
from foldback.planner.kernels.path_annealing import RANDOM, Field, Schedule, draw, energy_of

Ints = NDArray[np.int64]

RING: Final = 6
"""Number of tetrahedra around a diagonal of a unit cube."""
_COUNT, _SHARED, _COST, _STAMP = range(4)
_BARE: Final[dict[str, Any]] = INNER | {"_nrt": False}
"""Options of a kernel that creates no arrays; references to them are then not counted."""


class _Set(NamedTuple):
    """Tetrahedra, in any order, the place of each in that order, marks of nodes, and sums."""

    members: Ints
    slot: Ints
    marks: Ints
    stack: Ints
    ring: Ints
    sums: Ints


@njit(**INNER)
def _root(parents: Ints, k: int) -> int:
    while parents[k] != k:
        parents[k] = parents[parents[k]]
        k = parents[k]
    return k


@njit(**KERNEL)
def one_circuit(ends_at: Ints, counts: Ints, partner: Ints) -> int:
    """Joins edges at all nodes so that they make as few circuits as can be.

    Args:
        ends_at: (N, 4) edge ends at each node, opposite ones in places 0 and 1, 2 and 3 where four
            are there; the end ``2 e`` or ``2 e + 1`` of edge ``e``; −1 where none is.
        counts: (N,) how many of them there are: 2 or 4.
        partner: (2 E,) filled in: the edge end that each edge end is joined to.

    Returns:
        How many circuits there are: as many as the edges have connected parts.
    """
    edges = partner.size // 2
    parents = np.arange(edges)
    left = edges
    for node in range(counts.size):
        a, b = ends_at[node, 0], ends_at[node, 1]
        if counts[node] == 4:
            # Neighbouring ends, never opposite ones: 0 with 2, 1 with 3.
            b = ends_at[node, 2]
        partner[a] = b
        partner[b] = a
        left -= _union(parents, a // 2, b // 2)
        if counts[node] == 4:
            a, b = ends_at[node, 1], ends_at[node, 3]
            partner[a] = b
            partner[b] = a
            left -= _union(parents, a // 2, b // 2)
    for node in range(counts.size):
        if counts[node] != 4:
            continue
        a, c = ends_at[node, 0], ends_at[node, 1]
        if _union(parents, a // 2, c // 2):
            b, d = ends_at[node, 2], ends_at[node, 3]
            partner[a] = d
            partner[d] = a
            partner[c] = b
            partner[b] = c
            left -= 1
    return left


@njit(**INNER)
def _union(parents: Ints, a: int, b: int) -> bool:
    a = _root(parents, a)
    b = _root(parents, b)
    if a == b:
        return False
    parents[a] = b
    return True


@njit(**KERNEL)
def circuit_order(partner: Ints, first: int, order: Ints) -> int:
    """Follows a circuit from the edge end ``first`` on; fills in the ends by which edges are left.

    Returns:
        The number of edges in it.
    """
    count = 0
    end = first
    while True:
        out = end ^ 1
        order[count] = out
        count += 1
        end = partner[out]
        if end == first:
            return count


@njit(**_BARE)
def _find_ring(steps: Ints, corner: int, parity: int, ring: Ints) -> None:
    """Write the tetrahedra around the diagonal of a unit cube.

    Args:
        steps: (6,) differences of the flat indices of neighbouring nodes.
        corner: Flat index of the lowest corner.
        parity: 4, 2 and 1 added for odd coordinates x, y and z of that corner.
        ring: (6,) tetrahedra, written to.
    """
    count = 0
    for axis in range(3):
        first_axis, two = (axis + 1) % 3, (axis + 2) % 3
        for k in range(4):
            bits = parity ^ ((k & 1) << (2 - first_axis)) ^ ((k >> 1) << (2 - two))
            if bits in (0, 7) or bits ^ (4 >> axis) in (0, 7):
                continue
            node = corner + (k & 1) * steps[2 * first_axis] + (k >> 1) * steps[2 * two]
            ring[count] = 3 * node + axis
            count += 1


@njit(**_BARE)
def _toggle(group: _Set, tetrahedron: int) -> None:
    """Put a tetrahedron into the set, or take it out."""
    n = group.sums[_COUNT]
    at = group.slot[tetrahedron]
    if at < 0:
        group.slot[tetrahedron] = n
        group.members[n] = tetrahedron
        group.sums[_COUNT] = n + 1
        return
    last = group.members[n - 1]
    group.members[at] = last
    group.slot[last] = at
    group.slot[tetrahedron] = -1
    group.sums[_COUNT] = n - 1


@njit(**_BARE)
def _is_connected(group: _Set, steps: Ints) -> bool:
    """Return True if all members that touch the ring are connected by hinges.

    A part of the set that does not touch it would have been apart before the ring was changed.
    """
    group.sums[_STAMP] += 2
    stamp = group.sums[_STAMP]
    reached = stamp + 1
    missing = ZERO
    start = -1
    for k in range(RING):
        node = group.ring[k] // 3
        for end in (node, node + steps[2 * (group.ring[k] % 3)]):
            if group.marks[end] == stamp:
                continue
            for side in range(6):
                if group.slot[_beside(steps, end, side)] >= 0:
                    group.marks[end] = stamp
                    missing += 1
                    start = end
                    break
    if start < 0:
        return False
    group.marks[start] = reached
    missing -= 1
    group.stack[0] = start
    size = 1
    while size > 0 and missing > 0:
        size -= 1
        node = group.stack[size]
        for side in range(6):
            if group.slot[_beside(steps, node, side)] < 0:
                continue
            neighbour = node + steps[side]
            if group.marks[neighbour] == reached:
                continue
            if group.marks[neighbour] == stamp:
                missing -= 1
            group.marks[neighbour] = reached
            group.stack[size] = neighbour
            size += 1
    return missing == 0


@njit(**_BARE)
def _beside(steps: Ints, node: int, side: int) -> int:
    """Return the tetrahedron from a node to its neighbour on a side."""
    lower = node if side % 2 == 0 else node + steps[side]
    return 3 * lower + side // 2


@njit(**_BARE)
def _changed(field: Field, parities: Ints, group: _Set, limit: float) -> bool:
    """Try to exchange the tetrahedra of a ring beside a member; return True if that was done."""
    sums = group.sums
    member = group.members[draw(sums, sums[_COUNT])]
    axis = member % 3
    node = member // 3
    if draw(sums, 2) == 1:
        node += field.steps[2 * axis]
    corner = node
    octant = draw(sums, 8)
    for k in range(3):
        if octant & (1 << k):
            corner += field.steps[2 * k + 1]
    _find_ring(field.steps, corner, parities[corner], group.ring)
    count = ZERO
    fill = ZERO
    cost = ZERO
    for k in range(RING):
        tetrahedron = group.ring[k]
        if field.fill[tetrahedron] < 0:
            return False
        sign = 1 if group.slot[tetrahedron] < 0 else -1
        count += sign
        fill += sign * field.fill[tetrahedron]
        cost += sign * field.cost[tetrahedron]
    n = sums[_COUNT] + count
    if n > field.high or n < RING:
        return False
    old = energy_of(field, sums[_COUNT], sums[_SHARED], sums[_COST])
    new = energy_of(field, n, sums[_SHARED] + fill, sums[_COST] + cost)
    if new - old > limit:
        return False
    for k in range(RING):
        _toggle(group, group.ring[k])
    if not _is_connected(group, field.steps):
        for k in range(RING):
            _toggle(group, group.ring[k])
        return False
    sums[_SHARED] += fill
    sums[_COST] += cost
    return True


@njit(**KERNEL)
def anneal_trail(
    field: Field, schedule: Schedule, parities: Ints, corner: int, seed: int
) -> tuple[Ints, float]:
    """Anneal a set of tetrahedra with a closed trail.

    Args:
        field: The tetrahedra and the goal; ``fill`` and ``cost`` by their numbers.
        schedule: The moves; their kinds are not used.
        parities: (m,) 4, 2 and 1 added for odd coordinates x, y and z of each node.
        corner: Flat index of the lowest corner of the unit cube with the first ring.
        seed: Random seed, 0…2⁴⁸ − 1.

    Returns:
        (n,) numbers of the best tetrahedra, and their energy.
    """
    nodes = parities.shape[0]
    room = field.high + RING
    group = _Set(
        np.empty(room, dtype=np.int64),
        np.full(3 * nodes, -1, dtype=np.int64),
        np.zeros(nodes, dtype=np.int64),
        np.empty(nodes, dtype=np.int64),
        np.empty(RING, dtype=np.int64),
        np.zeros(6, dtype=np.int64),
    )
    group.sums[RANDOM] = seed
    _find_ring(field.steps, corner, parities[corner], group.ring)
    for k in range(RING):
        _toggle(group, group.ring[k])
        group.sums[_SHARED] += field.fill[group.ring[k]]
        group.sums[_COST] += field.cost[group.ring[k]]
    best_members = group.members.copy()
    best, count = _walk(field, schedule, parities, group, best_members)
    return best_members[:count].copy(), best


@njit(**_BARE)
def _walk(
    field: Field, schedule: Schedule, parities: Ints, group: _Set, best_members: Ints
) -> tuple[float, int]:
    sums = group.sums
    best = np.inf
    best_count = RING + ZERO
    temperature = schedule.hot
    for turn in range(schedule.moves):
        if turn % 256 == 255:
            temperature *= schedule.cooling
        limit = temperature * schedule.thresholds[draw(sums, 1024)]
        if not _changed(field, parities, group, limit):
            continue
        if 3 * turn < schedule.moves:  # hot in the first third
            continue
        value = energy_of(field, sums[_COUNT], sums[_SHARED], sums[_COST])
        if value < best - 1e-9:
            best = value
            best_count = sums[_COUNT]
            for k in range(best_count):
                best_members[k] = group.members[k]
    return best, best_count
