"""Layered paths: paths through doubled cells, one thin layer after the other.

A doubled cell is 2×2×2 cells, so each layer of doubled cells is two layers of 2×2 squares. Around a
spanning tree of the squares runs a closed way through all of a layer. It is begun where the layer
below was left and ends beside its beginning, where the next one begins. So there is a path wherever
each layer hangs together and lies on the one below, whatever the colours of the cells: and from its
far end it comes off layer by layer, with nothing above that is still folded.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.shapes.bridges import parts_of

ROUND_STEPS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""A path through a layer goes round a tree of 2×2 squares. Step (x, y), in cells, from each cell of
a square (in the order of ``SQUARE_CORNERS``) to the next cell of the same square."""
OUT_STEPS: Final = ((0, -1), (1, 0), (0, 1), (-1, 0))
"""A path through a layer goes round a tree of 2×2 squares. Step (x, y), in cells, from each cell of
a square (in the order of ``SQUARE_CORNERS``) into the neighbouring square, where the tree joins
both."""
SQUARE_CORNERS: Final = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Cells of a 2×2 square as (x, y) offsets from its first cell, anticlockwise, as a cycle through
the square alone visits them."""


def layered_path(coarse: Ints, axis: int, rng: np.random.Generator) -> Ints | None:
    """Return a path through doubled cells, layer by layer along an axis, or None.

    Args:
        coarse: (m, 3) the cells; cell c becomes the cells 2 c + {0, 1}³.
        axis: Axis along which the layers are counted.
        rng: Random choice between equals.

    Returns:
        (8 m, 3) the cells in order, the lowest layer first.
    """
    across = [k for k in range(3) if k != axis]
    extents = np.ptp(coarse, axis=0)
    across.sort(key=lambda k: int(extents[k]))  # short rows
    heights = np.unique(coarse[:, axis])
    layers = [coarse[coarse[:, axis] == height][:, across] for height in heights.tolist()]
    if len(heights) != extents[axis] + 1:
        return None
    for _ in range(4):
        cycles: list[dict[Cell, Cell]] = []
        for layer in layers:
            cycle = _cycle(layer, rng)
            if cycle is None:
                return None
            cycles += [cycle, cycle]
        ways = _joined(cycles, rng)
        if ways is not None:
            break
    else:
        return None
    path = np.empty((8 * len(coarse), 3), dtype=np.int64)
    at = 0
    for level, way in enumerate(ways):
        path[at : at + len(way), across] = way
        path[at : at + len(way), axis] = 2 * int(heights[0]) + level
        at += len(way)
    return path


def has_whole_layers(grid: Flags) -> bool:
    """Return True if the layers along some axis are connected; then a path mostly exists.

    Args:
        grid: (X, Y, Z) True for the cells of a connected solid.
    """
    return any(
        all(len(parts_of(layer)[1]) <= 1 for layer in np.moveaxis(grid, axis, 0))
        for axis in range(3)
    )


Cell = tuple[int, int]


def _cycle(squares: Ints, rng: np.random.Generator) -> dict[Cell, Cell] | None:
    """Return the successors of cells on a closed path through doubled squares, or None.

    The tree is a comb, as far as the squares allow: rows along the first axis, joined at one side.
    """
    from scipy.sparse import csr_array  # late: most folds have no layers
    from scipy.sparse.csgraph import minimum_spanning_tree

    index = {(x, y): k for k, (x, y) in enumerate(squares.tolist())}
    spine = int(rng.choice([squares[:, 0].min(), squares[:, 0].max()]))
    rows: list[int] = []
    columns: list[int] = []
    weights: list[float] = []
    for (x, y), k in index.items():
        for beside, weight in (((x + 1, y), 1.0), ((x, y + 1), 2.0 + abs(x - spine))):
            if beside in index:
                rows.append(k)
                columns.append(index[beside])
                weights.append(weight + 0.1 * float(rng.random()))
    # SciPy before 1.17.1 finds no spanning trees of graphs with 64-bit indices.
    links = np.array([rows, columns], dtype=np.int32)
    graph = csr_array((weights, links), shape=(len(index), len(index)))
    tree = minimum_spanning_tree(graph).tocoo()
    if tree.nnz != len(index) - 1:
        return None
    joined = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    following: dict[Cell, Cell] = {}
    for (x, y), k in index.items():
        for corner, turn, out in zip(SQUARE_CORNERS, ROUND_STEPS, OUT_STEPS, strict=True):
            next_cell = index.get((x + out[0], y + out[1]), -1)
            step = out if (k, next_cell) in joined or (next_cell, k) in joined else turn
            cell = (2 * x + corner[0], 2 * y + corner[1])
            following[cell] = (cell[0] + step[0], cell[1] + step[1])
    return following


def _joined(cycles: list[dict[Cell, Cell]], rng: np.random.Generator) -> list[Ints] | None:
    """Return the path through each layer; each begins above the end of the one before."""
    before = [{cell: last for last, cell in cycle.items()} for cycle in cycles]
    entered: list[dict[Cell, Cell | None]] = [dict.fromkeys(cycles[0])]
    for level in range(1, len(cycles)):
        reached: dict[Cell, Cell | None] = {}
        for cell in entered[-1]:
            for end in (before[level - 1][cell], cycles[level - 1][cell]):
                if end in cycles[level]:
                    reached[end] = cell
        if not reached:
            return None
        entered.append(reached)
    last = list(entered[-1])
    cell: Cell | None = last[int(rng.integers(len(last)))]
    end = cycles[-1][cell]
    ways: list[Ints] = []
    for level in range(len(cycles) - 1, -1, -1):
        assert cell is not None
        steps = before[level] if cycles[level][cell] == end else cycles[level]
        way = [cell]
        while steps[way[-1]] != cell:
            way.append(steps[way[-1]])
        ways.append(np.array(way, dtype=np.int64))
        cell, end = entered[level][cell], cell
    return ways[::-1]
