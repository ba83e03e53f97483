"""Kernels for Eulerian trails: pairings at nodes of degree two and four, and what they make."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL

Ints = NDArray[np.int64]


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
