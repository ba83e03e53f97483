"""Honeycomb: cells as tetrahedra of the tetragonal disphenoid honeycomb.

A tetrahedron is a pair of nodes (``planner.chain.trail``). Two kinds of cell are filled by
tetrahedra
that meet an even number of times at every node, so that sets of cells have Eulerian circuits: the
cube of side 2, which is one ring of 12, and the rhombic dodecahedron of 24. A cube and its ring
have the same volume; the ring's surface is that of its tetrahedra.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array

Nodes = NDArray[np.int64]
TETRAHEDRA_PER_RING: Final = 12
"""Number of tetrahedral modules in the closed ring that fills one cubic cell of a shape, of side 2
in the coordinates of this honeycomb of right-angle tetrahedra. A shape of n cells thus becomes a
chain of 12 n modules. A fact of geometry."""
_RING_PAIRS: Final = (
    *("123-223", "213-223", "312-322", "122-132", "212-312", "221-231"),
    *("321-322", "221-321", "212-213", "122-123", "231-232", "132-232"),
)
"""Tetrahedra of the closed ring that fills the cube from (1, 1, 1) to (3, 3, 3). ``123-223`` is the
tetrahedron whose two hinges have their middles at (1, 2, 3) and (2, 2, 3)."""


def ring_pairs(cells: Nodes) -> Nodes:
    """(12 m, 2, 3) node pairs of the rings in (m, 3) cubic cells; cell (0, 0, 0) is from 1 to 3."""
    pairs = np.array([[[int(c) for c in node] for node in p.split("-")] for p in _RING_PAIRS])
    return (pairs[None] + 2 * cells[:, None, None, :]).reshape(-1, 2, 3)


def dodecahedron_pairs(centres: Nodes) -> Nodes:
    """(24 m, 2, 3) node pairs of the rhombic dodecahedra around (m, 3) points.

    The points have even coordinates that add up to a multiple of four (a face-centred lattice).
    """
    pairs: list[tuple[list[int], list[int]]] = []
    for axis in range(3):
        for sign in (-1, 1):
            inner = [0, 0, 0]
            inner[axis] = sign
            for side in range(3):
                if side == axis:
                    continue
                for turn in (-1, 1):
                    outer = list(inner)
                    outer[side] = turn
                    pairs.append((inner, outer))
    return (np.array(pairs)[None] + centres[:, None, None, :]).reshape(-1, 2, 3)


def ring_of(nodes: Nodes, cells: Nodes) -> Nodes:
    """(n,) index of the cell in whose ring each module of a trail lies."""
    return rings_with(nodes[:-1] + nodes[1:], cells)


def rings_with(sums: Nodes, cells: Nodes) -> Nodes:
    """(n,) index of the cell in whose ring each tetrahedron lies, by the sum of its two nodes."""
    keys = ring_pairs(cells).sum(axis=1)
    _, inverse = np.unique(np.concatenate([keys, sums]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    place = np.empty(inverse.max() + 1, dtype=np.int64)
    place[inverse[: len(keys)]] = np.arange(len(keys)) // TETRAHEDRA_PER_RING
    return place[inverse[len(keys) :]]


def tetrahedra_at(points: Array) -> Nodes:
    """(P, 3) sums of the node pairs of the tetrahedra that points lie in.

    The first node is one step from the nearest point with even coordinates, along the axis on which
    the given point is farthest from that; the second node is a step further along the axis on which
    it is second farthest.
    """
    even = 2.0 * np.floor(0.5 * points + 0.5)
    apart = points - even
    _, second, first = np.argsort(np.abs(apart), axis=1, kind="stable").T
    rows = np.arange(len(points))
    sums = 2 * even.astype(np.int64)
    sums[rows, first] += np.where(apart[rows, first] > 0.0, 2, -2)
    sums[rows, second] += np.where(apart[rows, second] > 0.0, 1, -1)
    return sums
