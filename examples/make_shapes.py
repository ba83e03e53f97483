"""Make the example shapes: `python examples/make_shapes.py [NAME …]`.

A shape is drawn in a few lines of text or as boxes. Shapes that consist of 2×2×2 blocks get a path
by merging the blocks' cycles along a breadth-first tree, which never knots and unfolds well. Others
get one from the SAT solver of python-sat. Of some sixty seeds each shape has the one whose chain
straightened in the fewest steps; the same seed makes the same file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.lattice import surface
from foldback.planner.pathfinding.loose_block_merging import loose_block_path
from foldback.planner.pathfinding.sat_paths import find_path_by_sat
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.plan.shape_writers import write_path

SHAPES = FilePath(__file__).parent / "shapes"

Cell = tuple[int, int, int]
Cells = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Shape to make: its name, its title and how its path is found."""

    name: str
    title: str
    cells: frozenset[Cell]
    path: Callable[[frozenset[Cell], np.random.Generator], Cells | None]
    seed: int


def box(low: Cell, size: Cell) -> set[Cell]:
    """Return the cells of a box."""
    x, y, z = (range(a, a + n) for a, n in zip(low, size, strict=True))
    return set(product(x, y, z))


def picture(rows: str, *, scale: int, depth: int) -> set[Cell]:
    """Return the cells of a picture in text that lies on the ground, its rows going along x."""
    return {
        (scale * row + i, scale * y + j, z)
        for row, line in enumerate(rows.split())
        for y, mark in enumerate(line)
        if mark == "X"
        for i, j, z in product(range(scale), range(scale), range(depth))
    }


def mallet(head: Cell, handle: Cell) -> set[Cell]:
    """Return the cells of a head and, along x, of a handle from the middle of its side."""
    middle = (head[0], (head[1] - handle[1]) // 2, (head[2] - handle[2]) // 2)
    return box((0, 0, 0), head) | box(middle, handle)


def merged_blocks(cells: frozenset[Cell], rng: np.random.Generator) -> Cells | None:
    """Return a path through blocks, which need not lie on one common grid."""
    return loose_block_path(cells, rng)


def snake(cells: frozenset[Cell], rng: np.random.Generator) -> Cells:
    """Return the path row by row and layer by layer, back and forth, through a box."""
    del rng
    x, y, z = (max(c) + 1 for c in zip(*cells, strict=True))
    return snake_path((x, y, z))


def solved(cells: frozenset[Cell], rng: np.random.Generator) -> Cells | None:
    """Return a path with its ends on the surface, from the SAT solver."""
    order = np.array(sorted(cells))
    path_order = find_path_by_sat(order, rng, ends=surface(order)).order
    return None if path_order is None else order[path_order]


# The shapes ---------------------------------------------------------------------------------------

FINDERS = {"blocks": merged_blocks, "exact": solved, "snake": snake}


def drawing(name: str, title: str, finder: str, seed: int, cells: set[Cell]) -> Drawing:
    return Drawing(name=name, title=title, cells=frozenset(cells), path=FINDERS[finder], seed=seed)


def wrench(head: str, handle: str, rows: int, *, scale: int) -> set[Cell]:
    """Return the cells of jaws and a straight handle, two cells thick."""
    return picture(f"{head} {(handle + ' ') * rows}", scale=scale, depth=2)


SMALL_MALLET = picture("XXXXX " * 3 + "..X.. " * 9, scale=1, depth=1)
JAWS_94 = "XX...XX XX...XX XX...XX XXX.XXX .XXXXX."
JAWS_160 = "X...X X...X XXXXX .XXX."

DRAWINGS = (
    drawing("mallet-24", "Small mallet", "exact", 7, SMALL_MALLET),
    drawing("wrench-24", "Small wrench", "exact", 6, wrench("X.X X.X XXX", ".X.", 5, scale=1)),
    drawing("mallet-64", "Mallet", "blocks", 16, mallet((2, 6, 2), (10, 2, 2))),
    drawing("wrench-80", "Wrench", "blocks", 52, wrench("X.X XXX", ".X.", 5, scale=2)),
    drawing("mallet-80", "Mallet", "blocks", 19, mallet((4, 6, 2), (8, 2, 2))),
    drawing("wrench-94", "Wrench", "exact", 6, wrench(JAWS_94, "..XXX..", 8, scale=1)),
    drawing("wrench-160", "Open-end wrench", "blocks", 15, wrench(JAWS_160, "..X..", 8, scale=2)),
    drawing("mallet-160", "Mallet", "blocks", 48, mallet((4, 6, 4), (16, 2, 2))),
    drawing("mallet-192", "Large mallet", "blocks", 58, mallet((4, 8, 4), (16, 2, 2))),
    drawing("box-4x4x4", "Box, 4 × 4 × 4", "snake", 0, box((0, 0, 0), (4, 4, 4))),
    drawing("box-6x6x6", "Box, 6 × 6 × 6", "snake", 0, box((0, 0, 0), (6, 6, 6))),
)


def make(shape: Drawing) -> bytes:
    """Return the file of a shape."""
    cells = shape.path(shape.cells, np.random.default_rng(shape.seed))
    if cells is None:
        raise ValueError(f"no path through {shape.name} with seed {shape.seed}; try another one.")
    path = Path.from_cells(cells, name=shape.name)
    return write_path(path, title=f"{shape.title}, {len(path)} modules")


def main(names: list[str]) -> None:
    """Write the named shapes; all of them if none is named."""
    SHAPES.mkdir(exist_ok=True)
    for shape in DRAWINGS:
        if not names or shape.name in names:
            (SHAPES / f"{shape.name}.json").write_bytes(make(shape))
            print(f"{shape.name}: {len(shape.cells)} modules")


if __name__ == "__main__":
    main(sys.argv[1:])
