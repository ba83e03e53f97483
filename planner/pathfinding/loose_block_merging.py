"""Block merging for shapes whose 2×2×2 blocks lie on no common grid.

Two blocks may then touch with a part of a face, and there is no promise: of the cycles' edges that
face each other one pair is taken at random, and now and then none is left for a block.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product
from typing import TypeAlias

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import STEPS
from foldback.planner.pathfinding.block_merging import cut, cut_costs

Cell: TypeAlias = tuple[int, int, int]
Edge: TypeAlias = frozenset[Cell]


def block_corners(cells: frozenset[Cell]) -> list[Cell] | None:
    """Split cells into 2×2×2 blocks, lowest cell first; None if that fails."""
    remaining, corners = set(cells), list[Cell]()
    for corner in sorted(cells, key=lambda c: (c[2], c[1], c[0])):
        if corner in remaining:
            block = {_plus(corner, place) for place in product((0, 1), (0, 1), (0, 1))}
            if not block <= remaining:
                return None
            remaining -= block
            corners.append(corner)
    return corners


def loose_block_path(cells: frozenset[Cell], rng: np.random.Generator) -> Ints | None:
    """Return an (n, 3) path through blocks: the cycle cut at the smallest spread; or None."""
    cycle = loose_block_cycle(cells, rng)
    return None if cycle is None else cut(cycle, int(np.argmin(cut_costs(cycle))))


def loose_block_cycle(cells: frozenset[Cell], rng: np.random.Generator) -> Ints | None:
    """Return an (n, 3) closed cycle of rings joined along a breadth-first tree, or None."""
    corners = block_corners(cells)
    if corners is None:
        return None
    waiting = {corner: _ring(corner, rng) for corner in corners}
    edges = waiting.pop(corners[rng.integers(len(corners))])
    while waiting:
        # Everything that touches what is joined so far comes next: the tree is breadth-first.
        joined = 0
        for corner in rng.permutation(np.array(list(waiting))).tolist():
            block = (corner[0], corner[1], corner[2])
            swaps = list(_facing_edges(waiting[block], edges))
            if swaps:
                own_edge, facing_edge, links = swaps[rng.integers(len(swaps))]
                edges -= {own_edge, facing_edge}
                edges |= (waiting.pop(block) - {own_edge}) | links
                joined += 1
        if not joined:
            return None
    return np.array(_cycle_of(edges), dtype=np.int64)


def _plus(a: Cell, b: Cell) -> Cell:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _ring(corner: Cell, rng: np.random.Generator) -> set[Edge]:
    """Return the edges of a random Hamiltonian cycle of a block."""
    a, b, c = list(permutations((0, 1, 2)))[rng.integers(6)]
    place = [int(v) for v in rng.integers(0, 2, 3)]
    corners = list[Cell]()
    for axis in (a, b, a, c, a, b, a, c):
        corners.append(_plus(corner, (place[0], place[1], place[2])))
        place[axis] = 1 - place[axis]
    return {frozenset((corners[i], corners[(i + 1) % 8])) for i in range(8)}


def _facing_edges(block: set[Edge], edges: set[Edge]) -> Iterator[tuple[Edge, Edge, set[Edge]]]:
    """Yield pairs of parallel facing edges of two cycles, and the links that join them."""
    for own_edge in sorted(block, key=sorted):
        a, b = sorted(own_edge)
        for normal in STEPS:
            c, d = _plus(a, normal), _plus(b, normal)
            facing_edge = frozenset((c, d))
            if facing_edge in edges:
                yield own_edge, facing_edge, {frozenset((a, c)), frozenset((b, d))}


def _cycle_of(edges: set[Edge]) -> list[Cell]:
    """Return the cells of a cycle in order."""
    near: dict[Cell, list[Cell]] = {}
    for edge in sorted(edges, key=sorted):
        a, b = sorted(edge)
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    start = min(near)
    order = [start, near[start][0]]
    while len(order) < len(near):
        first, second = near[order[-1]]
        order.append(second if first == order[-2] else first)
    return order
