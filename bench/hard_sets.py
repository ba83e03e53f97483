"""Sets of 94–300 cells that may have no path; the search solves some and refutes others.

They are random growths, sponges, thin walls and sheets with holes. Separate parts, dead ends and
unequal numbers of black and white cells are repaired, because simple tests would refuse those sets.
Nothing else makes a path likely.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.feasible_sets import MAX_SET_CELLS, MIN_SET_CELLS, Cell, FeasibleSet
from foldback.planner.pathfinding.lattice import STEPS, colours

HARD_SETS_SEED = 300
"""Random seed of all 48 sets of cells that may or may not have a path. Another value draws other
sets, for which the stored results do not hold, so the benchmark ends with an error."""
HARD_SETS_PER_KIND = 12
"""Number of sets of cells of each of the four kinds (random growths, sponges, thin walls, sheets
with holes) that may or may not have a path. The stored results are for this
number; a larger one takes longer."""


def hard_sets() -> Iterator[FeasibleSet]:
    """Yield the 48 sets, which are the same in each run."""
    for kind, make in enumerate((_growth, _sponge, _walls, _sheet)):
        k = count = 0
        while count < HARD_SETS_PER_KIND:
            rng = np.random.default_rng([HARD_SETS_SEED, kind, k])
            k += 1
            cells = _mended(make(rng), rng)
            if MIN_SET_CELLS <= len(cells) <= MAX_SET_CELLS:
                name = f"{make.__name__.removeprefix('_')}-{count}"
                yield FeasibleSet(name=name, cells=np.array(sorted(cells), dtype=np.int64))
                count += 1


def _growth(rng: np.random.Generator) -> set[Cell]:
    """Add cells at random, mostly where they touch two cells or more."""
    cells: set[Cell] = {(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)}
    size = int(rng.integers(MIN_SET_CELLS, MAX_SET_CELLS - 20))
    while len(cells) < size:
        rim = sorted({c for cell in cells for c in _around(cell)} - cells)
        cell = rim[int(rng.integers(len(rim)))]
        if sum(c in cells for c in _around(cell)) >= 2 or rng.random() < 0.02:
            cells.add(cell)
    return cells


def _sponge(rng: np.random.Generator) -> set[Cell]:
    """Return a block from which random cells have been removed."""
    sides = rng.integers(6, 9, size=3)
    cells_kept = np.argwhere(rng.random(sides) < rng.uniform(0.5, 0.7))
    return {(x, y, z) for x, y, z in cells_kept.tolist()}


def _walls(rng: np.random.Generator) -> set[Cell]:
    """Return two or three walls that cross each other, one cell thick."""
    side = int(rng.integers(7, 10))
    cells: set[Cell] = set()
    for axis in (0, 1, 2)[: int(rng.integers(2, 4))]:
        place = int(rng.integers(1, side - 1))
        low, high = int(rng.integers(0, 2)), side - int(rng.integers(0, 2))
        for a in range(low, high):
            for b in range(low, high):
                cell = [a, b]
                cell.insert(axis, place)
                cells.add((cell[0], cell[1], cell[2]))
    return cells


def _sheet(rng: np.random.Generator) -> set[Cell]:
    """Return a sheet, one or two cells thick, with small rectangular holes."""
    thick = int(rng.integers(1, 3))
    a, b = (int(n) for n in rng.integers(12, 19, size=2))
    if thick == 2:
        a = int(rng.integers(7, 12))
    cells = {(x, y, z) for x in range(a) for y in range(b) for z in range(thick)}
    for _ in range(int(rng.integers(a * b // 20, a * b // 8))):
        x, y, w, h = (int(n) for n in rng.integers([0, 0, 1, 1], [a, b, 3, 3]))
        cells -= {(i, j, z) for i in range(x, x + w) for j in range(y, y + h) for z in range(thick)}
    return cells


def _mended(cells: set[Cell], rng: np.random.Generator) -> set[Cell]:
    """Return the largest part without dead ends, filled up to as many black as white cells."""
    while True:
        cells = _largest(cells)
        ends = {c for c in cells if sum(n in cells for n in _around(c)) < 2}
        if not cells or not ends:
            break
        cells -= ends
    for _ in range(200):
        order = sorted(cells)
        shades = colours(np.array(order, dtype=np.int64).reshape(-1, 3)) if order else np.zeros(0)
        excess = len(order) - 2 * int(shades.sum())
        if abs(excess) <= 1:
            return cells
        extra = 0 if excess > 0 else 1
        # Add a cell of the rarer colour, if possible one that is not a dead end.
        rim = sorted({n for c in cells for n in _around(c)} - cells)
        fit = [
            c for c in rim if sum(c) % 2 != extra and sum(n in cells for n in _around(c)) >= 2
        ] or [c for c in rim if sum(c) % 2 != extra]
        cells = cells | {fit[int(rng.integers(len(fit)))]}
    return set()


def _largest(cells: set[Cell]) -> set[Cell]:
    best: set[Cell] = set()
    unvisited = set(cells)
    while unvisited:
        part, heap = set[Cell](), [min(unvisited)]
        while heap:
            cell = heap.pop()
            if cell in unvisited:
                unvisited.discard(cell)
                part.add(cell)
                heap += _around(cell)
        best = max(best, part, key=len)
    return best


def _around(cell: Cell) -> list[Cell]:
    return [(cell[0] + a, cell[1] + b, cell[2] + c) for a, b, c in STEPS]
