"""Trail search: trails through the tetrahedra of cells, from circuits that are cut where best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.chain.honeycomb import ring_pairs
from foldback.planner.chain.trail import Trail
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.eulerian_circuits import cut_open, eulerian_circuit, free_cuts
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import index_of, parts
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pathfinding.path_search import MAX_CHOICE_MODULES, MAX_KNOT_CELLS
from foldback.planner.shapes.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrailSearch:
    """Trails through a shape's tetrahedra.

    Attributes:
        trails: Trails, the best first.
        reasons: Reasons why there are none with the requested ends.
    """

    trails: tuple[Trail, ...]
    reasons: tuple[PathReason, ...] = ()


def find_trails(
    shape: Shape,
    *,
    ends: str = "any",
    start: Cell | None = None,
    seed: int = 0,
) -> TrailSearch:
    """Fill each cell with its ring of twelve tetrahedra and find trails through all.

    Unknotted ones come first, then those with both ends free, then the plainest.

    Args:
        shape: Shape with face-connected cells.
        ends: ``surface`` when no other module may use the hinge edges at the ends.
        start: The cell in whose ring the chain begins, None for any.
        seed: Seed of all random choices.

    Raises:
        InputError: ``no-trail`` when the cells are in several parts, ``not-a-cell`` for a start
            that is not among them.
    """
    first = index_of(shape.cells, start)
    if parts(shape.cells)[0] > 1:
        raise InputError(
            "no-trail",
            f"the cells are in {parts(shape.cells)[0]} parts, but the chain passes from "
            "cell to cell through their faces; join the parts or keep one part.",
        )
    first_cell = None if first is None else shape.cells[first]
    return trails_through(shape, ring_pairs(shape.cells), ends=ends, first=first_cell, seed=seed)


def trails_through(
    shape: Shape, pairs: Ints, *, ends: str = "any", first: Ints | None = None, seed: int = 0
) -> TrailSearch:
    """Find trails through all of some tetrahedra.

    Args:
        shape: The cells, for the name and the size.
        pairs: (n, 2, 3) node pairs, of which an even number meets at each node.
        ends: See ``find_trails``.
        first: (3,) cell with the tetrahedra of which one is first, None for any.
        seed: Seed of all random choices.

    Raises:
        InputError: ``no-trail`` for pairs in several parts.
    """
    trail_count = 4 if len(pairs) <= MAX_CHOICE_MODULES else 1
    ranked_trails: dict[bytes, tuple[tuple[int, int, int], Trail]] = {}
    for k in range(trail_count):
        # Merging along a direction gives a tidy tree; at random, the chain takes twice the steps.
        along = np.random.default_rng((seed, k)).normal(size=3) if k else None
        nodes = eulerian_circuit(pairs, along)
        free = free_cuts(nodes)
        allowed = _cuts(nodes, first)
        if ends == "surface" and not (allowed & free).any():
            reason = PathReason.of(PathCode.START_SHARES_HINGES)
            return TrailSearch(trails=(), reasons=(reason,))
        if (allowed & free).any():
            allowed &= free
        cut = _best_cut(nodes, np.flatnonzero(allowed))
        trail = Trail.from_nodes(cut_open(nodes, cut), name=shape.name, pitch_m=0.5 * shape.pitch_m)
        knotted = 0
        if len(trail) <= MAX_KNOT_CELLS:
            knotted = 0 if knot_of(trail.nodes).verdict == "unknot" else 1
        rank = (knotted, int(not free[cut]), k)
        ranked_trails[trail.nodes.tobytes()] = (rank, trail)
    ranked = sorted(ranked_trails.values(), key=lambda entry: entry[0])
    return TrailSearch(trails=tuple(trail for _, trail in ranked))


def _cuts(nodes: Ints, first: Ints | None) -> Flags:
    """Return (k,) True for modules before which the circuit may be cut."""
    if first is None:
        return np.ones(len(nodes) - 1, dtype=np.bool_)
    own_pairs = ring_pairs(first[None]).sum(axis=1)
    sums = nodes[:-1] + nodes[1:]
    return (sums[:, None, :] == own_pairs[None]).all(axis=2).any(axis=1)


def _best_cut(nodes: Ints, allowed: Ints) -> int:
    """Return the cut farthest from the middle: the explosion then pulls on both ends first.

    It halves the steps that a wrench takes, whereas a cut after which modules that meet lie closest
    along the chain doubles them (``docs/decisions/0007-tetrahedra.md``).
    """
    off = nodes[:-1] - nodes[:-1].mean(axis=0)
    return int(allowed[np.argmax((off[allowed] ** 2).sum(axis=1))])
