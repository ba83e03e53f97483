"""Honeycomb: cells as tetrahedra of the tetragonal disphenoid honeycomb.

A tetrahedron is a pair of nodes (``planner.trails``). Two kinds of cell are filled by tetrahedra
that meet an even number of times at every node, so that sets of cells have Eulerian circuits: the
cube of side 2, which is one ring of 12, and the rhombic dodecahedron of 24. A cube and its ring have
the same volume; the ring's surface is that of its tetrahedra.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Nodes = NDArray[np.int64]
RING: Final = 12
DODECAHEDRON: Final = 24
_RING_PAIRS: Final = (
    *("123-223", "213-223", "312-322", "122-132", "212-312", "221-231"),
    *("321-322", "221-321", "212-213", "122-123", "231-232", "132-232"),
)
"""Nodes of the ring in the cube from (1, 1, 1) to (3, 3, 3)."""


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
