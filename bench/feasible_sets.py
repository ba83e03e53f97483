"""One hundred sets of 94–300 cells that have a path, because each was built from one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foldback.planner.pathfinding.block_merging import block_path
from foldback.planner.pathfinding.lattice import STEPS

Ints = NDArray[np.int64]
Cell = tuple[int, int, int]

FEASIBLE_SETS_SEED = 94
"""Random seed of all one hundred sets of cells through which the benchmark searches paths. Another
value draws other sets, for which the stored results do not hold, so the benchmark ends with an
error."""
MIN_SET_CELLS, MAX_SET_CELLS = 94, 300
"""Smallest and largest number of cells of a set."""
FEASIBLE_SETS_PER_KIND = 25
"""Number of sets of cells of each of the four kinds through which the benchmark searches paths:
loose, dense and packed random walks, and solids. The stored results are for this number; a larger
one takes longer."""
NEIGHBOUR_WEIGHTS = {"loose": 1.0, "dense": 4.0, "packed": 20.0}
"""Weight of a step of a random walk, by kind of set: the base whose exponent is the number of the
new cell's neighbours on the walk."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeasibleSet:
    """One set of cells.

    Attributes:
        name: Kind and number of the set.
        cells: (n, 3) cells in lexicographic order.
    """

    name: str
    cells: Ints


def feasible_sets() -> Iterator[FeasibleSet]:
    """Yield the hundred sets: random walks, loose to dense, and solids without some end cells."""
    for kind, neighbour_weight in NEIGHBOUR_WEIGHTS.items():
        for k in range(FEASIBLE_SETS_PER_KIND):
            number = list(NEIGHBOUR_WEIGHTS).index(kind)
            rng = np.random.default_rng([FEASIBLE_SETS_SEED, number, k])
            walk = _walk(int(rng.integers(MIN_SET_CELLS, MAX_SET_CELLS + 1)), neighbour_weight, rng)
            yield FeasibleSet(name=f"{kind}-{k}", cells=np.unique(walk, axis=0))
    for k in range(FEASIBLE_SETS_PER_KIND):
        rng = np.random.default_rng([FEASIBLE_SETS_SEED, len(NEIGHBOUR_WEIGHTS), k])
        yield FeasibleSet(name=f"solid-{k}", cells=np.unique(_worn_solid(rng), axis=0))


def _walk(length: int, neighbour_weight: float, rng: np.random.Generator) -> Ints:
    """Draw a self-avoiding walk that prefers free cells with many neighbours on the walk."""
    while True:
        cells: list[Cell] = [(0, 0, 0)]
        visited = set(cells)
        while len(cells) < length:
            free = [cell for cell in _around(cells[-1]) if cell not in visited]
            if not free:
                cells.reverse()  # continue at the other end
                free = [cell for cell in _around(cells[-1]) if cell not in visited]
                if not free:
                    break
            touching = [sum(c in visited for c in _around(cell)) for cell in free]
            weights = np.array([neighbour_weight**count for count in touching])
            cells.append(free[int(rng.choice(len(free), p=weights / weights.sum()))])
            visited.add(cells[-1])
        if len(cells) == length:
            return np.array(cells, dtype=np.int64)


def _worn_solid(rng: np.random.Generator) -> Ints:
    """Draw a convex solid of 2×2×2 blocks; return its path without some cells at both ends."""
    while True:
        sides = rng.integers(2, 6, size=3)
        grid = np.argwhere(np.ones(sides, dtype=bool))
        depth = np.abs((grid - (sides - 1) / 2) / (sides / 2)) ** rng.uniform(1.5, 6.0)
        blocks = grid[depth.sum(axis=1) <= rng.uniform(0.9, 1.4)]
        worn = int(rng.integers(1, 8))
        if MIN_SET_CELLS + worn <= 8 * len(blocks) <= MAX_SET_CELLS and _connected(blocks):
            path = block_path(blocks, rng, tree="random")
            head = int(rng.integers(0, worn + 1))
            return path[head : len(path) - (worn - head)]


def _connected(blocks: Ints) -> bool:
    cells = {(x, y, z) for x, y, z in blocks.tolist()}
    reached = [next(iter(sorted(cells)))]
    unreached = cells - set(reached)
    for cell in reached:
        near = unreached.intersection(_around(cell))
        reached += sorted(near)
        unreached -= near
    return not unreached


def _around(cell: Cell) -> list[Cell]:
    return [(cell[0] + a, cell[1] + b, cell[2] + c) for a, b, c in STEPS]
