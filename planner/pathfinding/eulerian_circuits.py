"""Eulerian circuits through sets of tetrahedra, cut open into trails. Linear in their number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Flags
from foldback.planner.chain.trail import hinge_axes
from foldback.planner.core import circuit_order, one_circuit
from foldback.planner.errors import InputError

Nodes = NDArray[np.int64]


def eulerian_circuit(pairs: Nodes, along: Array | None = None) -> Nodes:
    """Return a circuit that uses each tetrahedron once and bends where four meet.

    At a node with all four tetrahedra, joining opposite ones would lead the chain through itself;
    neighbouring ones can be joined in two ways, and the other way merges two circuits into one
    (Hierholzer's merging with the choice that this lattice leaves).

    Args:
        pairs: (n, 2, 3) node pairs, each tetrahedron once.
        along: (3,) direction along which nodes are visited to merge circuits; x if None.

    Returns:
        (n + 1, 3) nodes in order; the last equals the first.

    Raises:
        InputError: ``no-trail``: an odd number meets at a node, or there are several parts.
    """
    n = len(pairs)
    nodes, ends = np.unique(pairs.reshape(-1, 3), axis=0, return_inverse=True)
    ends = ends.reshape(-1)
    counts = np.bincount(ends, minlength=len(nodes))
    if (counts % 2).any():
        odd = int((counts % 2).sum())
        node_text = tuple(map(int, nodes[np.argmax(counts % 2)]))
        raise InputError(
            "no-trail",
            f"got {odd} corner points (nodes) where an odd number of tetrahedra meet, expected an "
            "even number at each node; only then can a closed trail visit every tetrahedron once.",
            where=f"node {node_text}",
        )
    # Opposite ends at a node next to each other: sorted by node, then by axis of the step.
    steps = pairs[:, 1] - pairs[:, 0]
    axis = np.repeat(np.argmax(np.abs(steps), axis=1), 2)
    order = np.lexsort((axis, ends))
    ends_at = np.full((len(nodes), 4), -1)
    rank = np.arange(2 * n) - np.repeat(np.cumsum(counts) - counts, counts)
    ends_at[ends[order], rank] = order
    if along is not None:
        node_order = np.argsort(nodes @ along, kind="stable")
        ends_at, counts = ends_at[node_order], counts[node_order]
    partner = np.full(2 * n, -1)
    parts = int(one_circuit(ends_at, counts, partner))
    if parts > 1:
        raise InputError(
            "no-trail",
            f"got tetrahedra in {parts} parts that share no hinge, expected one connected part; "
            "join the parts at the faces of cells, or keep one part.",
        )
    exits = np.empty(n, dtype=np.int64)
    circuit_order(partner, 0, exits)
    entered = exits ^ 1
    flat = pairs.reshape(-1, 3)
    return np.concatenate([flat[entered[:1]], flat[exits]])


def cut_open(nodes: Nodes, start: int) -> Nodes:
    """Return a circuit cut open so that it begins with module ``start``."""
    ring = nodes[:-1]
    turned = np.roll(ring, -start, axis=0)
    return np.concatenate([turned, turned[:1]])


def free_cuts(nodes: Nodes) -> Flags:
    """Return (n,) flags: a cut before module i leaves both ends at hinges of their own."""
    ring = nodes[:-1]
    _, inverse, counts = np.unique(ring, axis=0, return_inverse=True, return_counts=True)
    return counts[inverse.reshape(-1)] == 1


__all__ = ["cut_open", "eulerian_circuit", "free_cuts", "hinge_axes"]
