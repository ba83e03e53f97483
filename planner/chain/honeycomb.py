"""Honeycomb: cells as tetrahedra of the tetragonal disphenoid honeycomb.

A tetrahedron is a pair of nodes (``planner.chain.trail``). Two kinds of cell are filled by
tetrahedra
that meet an even number of times at every node, so that sets of cells have Eulerian circuits: the
cube of side 2, which is one ring of 12, and the rhombic dodecahedron of 24. A cube and its ring
have the same volume; the ring's surface is that of its tetrahedra.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array
from planner.chain.module import TETRAHEDRON
from planner.chain.trail import hinge_axes

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
    keys = ring_pairs(cells).sum(axis=1)
    wanted = nodes[:-1] + nodes[1:]
    _, inverse = np.unique(np.concatenate([keys, wanted]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    place = np.empty(inverse.max() + 1, dtype=np.int64)
    place[inverse[: len(keys)]] = np.arange(len(keys)) // TETRAHEDRA_PER_RING
    return place[inverse[len(keys) :]]


def tetrahedra_at(points: Array) -> Nodes:
    """(P, 3) sums of the node pairs of the tetrahedra that points lie in.

    The honeycomb repeats every two steps along each axis; of the tetrahedra that reach into one
    such box, each point is in one (in several on their faces: then the first).
    """
    box = np.floor(points / 2.0)
    inside = points - 2.0 * box
    found = np.full(len(points), -1)
    sums, normals, reaches = _base_patch()
    for k in range(len(sums)):
        left = np.flatnonzero(found < 0)
        if not len(left):
            break
        hit = (inside[left] @ normals[k].T <= reaches[k] + 1e-9).all(axis=1)
        found[left[hit]] = k
    return sums[found] + 4 * box.astype(np.int64)


@cache
def _base_patch() -> tuple[Nodes, Array, Array]:
    """Tetrahedra around the box from 0 to 2: sums of node pairs, face normals and reaches."""
    grid = np.stack(np.meshgrid(*[np.arange(-2, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    odd = (grid % 2 != 0).sum(axis=1)
    nodes = grid[(odd == 1) | (odd == 2)]
    pairs = np.concatenate(
        [np.stack([nodes, nodes + step], axis=1) for step in np.eye(3, dtype=int)]
    )
    odd = (pairs[:, 1] % 2 != 0).sum(axis=1)
    pairs = pairs[(odd == 1) | (odd == 2)]
    near = ((pairs.mean(axis=1) > -1.0) & (pairs.mean(axis=1) < 3.0)).all(axis=1)
    pairs = pairs[near]
    frames = _frames(pairs)
    normals = np.einsum("pij,aj->pai", frames, TETRAHEDRON.face_normals)
    middle = pairs.mean(axis=1)
    reach = (TETRAHEDRON.vertices @ TETRAHEDRON.face_normals.T).max(axis=0)
    return pairs.sum(axis=1), normals, np.einsum("pai,pi->pa", normals, middle) + reach


def _frames(pairs: Nodes) -> Array:
    """(n, 3, 3) orientations of the tetrahedra between node pairs."""
    along = (pairs[:, 1] - pairs[:, 0]).astype(np.float64)
    across = np.eye(3)[hinge_axes(pairs[:, 0])]
    return np.stack([along, across, np.cross(along, across)], axis=-1)
