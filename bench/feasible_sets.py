"""A hundred sets of 94–300 cells that have a path, because a path is what they were made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.pathfinding.blocks import block_path
from planner.pathfinding.lattice import STEPS

Ints = NDArray[np.int64]
Cell = tuple[int, int, int]

SEED = 94
FEWEST, MOST = 94, 300
EACH = 25
FONDNESS = {"loose": 1.0, "dense": 4.0, "packed": 20.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeasibleSet:
    """One of the sets: its name and (n, 3) cells in lexicographic order."""

    name: str
    cells: Ints


def feasible_sets() -> Iterator[FeasibleSet]:
    """The same hundred each time: random walks, loose to packed, and solids with worn ends."""
    for kind, fondness in FONDNESS.items():
        for k in range(EACH):
            rng = np.random.default_rng([SEED, list(FONDNESS).index(kind), k])
            walk = _walk(int(rng.integers(FEWEST, MOST + 1)), fondness, rng)
            yield FeasibleSet(name=f"{kind}-{k}", cells=np.unique(walk, axis=0))
    for k in range(EACH):
        rng = np.random.default_rng([SEED, len(FONDNESS), k])
        yield FeasibleSet(name=f"solid-{k}", cells=np.unique(_worn_solid(rng), axis=0))


def _walk(length: int, fondness: float, rng: np.random.Generator) -> Ints:
    """A self-avoiding walk that likes free cells with many neighbours on it."""
    while True:
        cells: list[Cell] = [(0, 0, 0)]
        seen = set(cells)
        while len(cells) < length:
            free = [cell for cell in _around(cells[-1]) if cell not in seen]
            if not free:
                cells.reverse()  # go on at the other end
                free = [cell for cell in _around(cells[-1]) if cell not in seen]
                if not free:
                    break
            weights = np.array([fondness ** sum(c in seen for c in _around(x)) for x in free])
            cells.append(free[int(rng.choice(len(free), p=weights / weights.sum()))])
            seen.add(cells[-1])
        if len(cells) == length:
            return np.array(cells, dtype=np.int64)


def _worn_solid(rng: np.random.Generator) -> Ints:
    """A blob, a slab or a ring of 2×2×2 blocks, whose path has lost some cells at its ends."""
    while True:
        sides = rng.integers(2, 6, size=3)
        grid = np.argwhere(np.ones(sides, dtype=bool))
        away = np.abs((grid - (sides - 1) / 2) / (sides / 2)) ** rng.uniform(1.5, 6.0)
        blocks = grid[away.sum(axis=1) <= rng.uniform(0.9, 1.4)]
        worn = int(rng.integers(1, 8))
        if FEWEST + worn <= 8 * len(blocks) <= MOST and _connected(blocks):
            path = block_path(blocks, rng, tree="random")
            head = int(rng.integers(0, worn + 1))
            return path[head : len(path) - (worn - head)]


def _connected(blocks: Ints) -> bool:
    cells = {(x, y, z) for x, y, z in blocks.tolist()}
    reached = [next(iter(sorted(cells)))]
    left = cells - set(reached)
    for cell in reached:
        near = left.intersection(_around(cell))
        reached += sorted(near)
        left -= near
    return not left


def _around(cell: Cell) -> list[Cell]:
    return [(cell[0] + a, cell[1] + b, cell[2] + c) for a, b, c in STEPS]
