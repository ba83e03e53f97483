"""End proofs: sets of cells in which a path would need more ends than it has.

Every cell of a path has two neighbours along it, and each of the two ends has one. No two cells of
one colour of a chessboard touch, so a set S of them takes 2 |S| places, less its ends, among its
neighbours; a neighbour that touches k cells of S has min(k, 2) places for them. A set with too few
places proves that there is no path, and anyone can check it by counting.

There is such a set exactly when the relaxation by degrees (n − 1 edges, at most two at each cell)
has no solution. It is a bipartite 2-matching, so a maximum flow decides it, and a minimum cut is
the set (Schrijver, Combinatorial Optimization, 2003, chapter 21).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints

PATH_ENDS: Final = 2
"""Number of ends of a path, and of the neighbours of each other cell along it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndProof:
    """Set of cells that would need more ends than a path has.

    Attributes:
        members: (k,) indices of the cells, all of one colour.
        around: Number of cells that touch them.
        places: Number of places that those cells have for them, at most two each.
        allowed: Maximum number of ends of a path among cells of this colour.
        missed: Ends beyond the allowed ones in the largest such set.
    """

    members: Ints
    around: int
    places: int
    allowed: int
    missed: int

    @property
    def needed(self) -> int:
        """Number of ends that a path would need among the cells."""
        return PATH_ENDS * len(self.members) - self.places


def end_proof(near: Ints, balance: Ints) -> EndProof | None:
    """Search for a set of cells that would need too many ends; None without one.

    Args:
        near: (n, 6) indices of the neighbours of each cell, -1 for none.
        balance: (n,) 1 for cells of one colour of a chessboard, -1 for the other. The numbers of
            both colours differ by at most one.
    """
    proofs = [
        proof
        for colour in (1, -1)
        if (proof := _proof_of_colour(near, balance == colour, colour * int(balance.sum())))
    ]
    return min(proofs, key=lambda proof: len(proof.members), default=None)


def _proof_of_colour(near: Ints, coloured: Flags, excess: int) -> EndProof | None:
    members = _cut(near, coloured)
    allowed = 1 + excess
    missed = _needed(near, members) - allowed
    if missed <= 0:
        return None
    for cell in members.tolist():
        fewer = members[members != cell]
        if _needed(near, fewer) > allowed:
            members = fewer
    touched = _touches(near, members)
    return EndProof(
        members=members,
        around=int((touched > 0).sum()),
        places=int(np.minimum(touched, PATH_ENDS).sum()),
        allowed=allowed,
        missed=missed,
    )


def _touches(near: Ints, members: Ints) -> Ints:
    """Return how many of the members each cell touches."""
    touching = near[members].ravel()
    return np.bincount(touching[touching >= 0], minlength=len(near))


def _needed(near: Ints, members: Ints) -> int:
    places = np.minimum(_touches(near, members), PATH_ENDS).sum()
    return PATH_ENDS * len(members) - int(places)


def _cut(near: Ints, coloured: Flags) -> Ints:
    """Return the cells of one colour on the source's side of a minimum cut."""
    from scipy.sparse import csr_array  # late: most paths need no proof
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    n = len(near)
    sources, sinks = np.flatnonzero(coloured), np.flatnonzero(~coloured)
    rows, columns = np.nonzero(near[sources] >= 0)
    froms = np.concatenate([np.full(len(sources), n), sources[rows], sinks])
    tos = np.concatenate([sources, near[sources[rows], columns], np.full(len(sinks), n + 1)])
    room = np.ones(len(froms), dtype=np.int32)
    room[: len(sources)] = room[len(sources) + len(rows) :] = PATH_ENDS
    network = csr_array((room, (froms, tos)), shape=(n + 2, n + 2))
    residual = network - maximum_flow(network, n, n + 1).flow
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, n, return_predecessors=False)
    return sources[np.isin(sources, reached)]
