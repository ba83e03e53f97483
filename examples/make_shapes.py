"""Makes the example shapes: `python examples/make_shapes.py [NAME …]`.

A shape is drawn in a few lines of text or as boxes. Shapes that consist of 2×2×2 blocks get a path
by merging the blocks' cycles along a breadth-first tree, which never knots and unfolds well. Others
get one from OR-tools' CP-SAT (`pip install ortools`). The seeds are those of some sixty tried whose
chains came out straight in the fewest steps; the same seed makes the same file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path as FilePath

import numpy as np

from planner.formats import write_path
from planner.paths import Path

SHAPES = FilePath(__file__).parent / "shapes"

Cell = tuple[int, int, int]
Edge = tuple[Cell, Cell]


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A shape to make: its name, its title and how its path is found."""

    name: str
    title: str
    cells: frozenset[Cell]
    path: Callable[[frozenset[Cell], np.random.Generator], list[Cell] | None]
    seed: int


def box(low: Cell, size: Cell) -> set[Cell]:
    """Cells of a box."""
    x, y, z = (range(a, a + n) for a, n in zip(low, size, strict=True))
    return set(product(x, y, z))


def picture(rows: str, *, scale: int, depth: int) -> set[Cell]:
    """Cells of a picture in text that lies on the ground, its rows going along x."""
    return {
        (scale * row + i, scale * y + j, z)
        for row, line in enumerate(rows.split())
        for y, mark in enumerate(line)
        if mark == "X"
        for i, j, z in product(range(scale), range(scale), range(depth))
    }


def mallet(head: Cell, handle: Cell) -> set[Cell]:
    """A head and, along x, a handle from the middle of its side."""
    middle = (head[0], (head[1] - handle[1]) // 2, (head[2] - handle[2]) // 2)
    return box((0, 0, 0), head) | box(middle, handle)


def plus(a: Cell, b: Cell) -> Cell:
    """The cell at b, seen from a."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


NORMALS: tuple[Cell, ...] = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


# Blocks -------------------------------------------------------------------------------------------


def block_corners(cells: frozenset[Cell]) -> list[Cell] | None:
    """Splits cells into 2×2×2 blocks, lowest cell first; None when that way fails."""
    left, corners = set(cells), list[Cell]()
    while left:
        corner = min(left, key=lambda c: (c[2], c[1], c[0]))
        block = box(corner, (2, 2, 2))
        if not block <= left:
            return None
        left -= block
        corners.append(corner)
    return corners


def ring(corner: Cell, rng: np.random.Generator) -> set[frozenset[Cell]]:
    """Edges of one of the Hamiltonian cycles of a 2×2×2 block."""
    a, b, c = list(permutations(np.eye(3, dtype=int).tolist()))[rng.integers(6)]
    steps = (a, b, [-v for v in a], c, a, [-v for v in b], [-v for v in a])
    places = [tuple(int(v) for v in rng.integers(0, 2, 3))]
    for step in steps:
        # Any corner may begin: a step outward is the same step mirrored.
        axis = int(np.argmax(np.abs(step)))
        moved = list(places[-1])
        moved[axis] = 1 - moved[axis]
        places.append((moved[0], moved[1], moved[2]))
    found = [plus(corner, p) for p in places]
    return {frozenset((found[i], found[(i + 1) % 8])) for i in range(8)}


def merged_blocks(cells: frozenset[Cell], rng: np.random.Generator) -> list[Cell] | None:
    """A path through blocks: their rings joined along a breadth-first tree, then cut."""
    corners = block_corners(cells)
    if corners is None:
        return None
    waiting = {corner: ring(corner, rng) for corner in corners}
    edges = waiting.pop(corners[rng.integers(len(corners))])
    while waiting:
        # Everything that touches what is joined so far comes next: the tree is breadth-first.
        joined = 0
        for corner in rng.permutation(np.array(list(waiting))).tolist():
            block = (corner[0], corner[1], corner[2])
            swaps = list(facing_edges(waiting[block], edges))
            if swaps:
                ours, theirs, links = swaps[rng.integers(len(swaps))]
                edges = (edges | waiting.pop(block)) - {ours, theirs} | links
                joined += 1
        if not joined:
            return None
    return best_cut(cells, cycle_of(edges))


def facing_edges(
    block: set[frozenset[Cell]], edges: set[frozenset[Cell]]
) -> Iterator[tuple[frozenset[Cell], frozenset[Cell], set[frozenset[Cell]]]]:
    """Pairs of parallel edges of two cycles that face each other, and what joins them."""
    for ours in sorted(block, key=sorted):
        a, b = sorted(ours)
        for normal in NORMALS:
            c, d = plus(a, normal), plus(b, normal)
            theirs = frozenset((c, d))
            if theirs in edges:
                yield ours, theirs, {frozenset((a, c)), frozenset((b, d))}


def cycle_of(edges: set[frozenset[Cell]]) -> list[Cell]:
    """Cells of a cycle in order."""
    near: dict[Cell, list[Cell]] = {}
    for edge in sorted(edges, key=sorted):
        a, b = sorted(edge)
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    start = min(near)
    order = [start, near[start][0]]
    while len(order) < len(near):
        one, other = near[order[-1]]
        order.append(other if one == order[-2] else one)
    return order


def best_cut(cells: frozenset[Cell], cycle: list[Cell]) -> list[Cell]:
    """The cycle cut where both ends lie on the surface and neighbours stay close along it."""
    cuts = [cycle[k:] + cycle[:k] for k in range(len(cycle))]
    outer = [cut for cut in cuts if on_surface(cut[0], cells) and on_surface(cut[-1], cells)]
    return min(outer or cuts, key=spread)


def on_surface(cell: Cell, cells: frozenset[Cell]) -> bool:
    """Whether a cell has a free face."""
    return any(plus(cell, normal) not in cells for normal in NORMALS)


def spread(order: list[Cell]) -> float:
    """How far along the path cells are that touch each other: less is easier to unfold."""
    place = {cell: k for k, cell in enumerate(order)}
    gaps = [
        abs(place[plus(cell, normal)] - k)
        for cell, k in place.items()
        for normal in NORMALS[::2]
        if plus(cell, normal) in place
    ]
    return float(np.mean(gaps))


# Boxes and exact cells ----------------------------------------------------------------------------


def snake(cells: frozenset[Cell], rng: np.random.Generator) -> list[Cell]:
    """Row by row and layer by layer, back and forth: the way through a box."""
    del rng
    nx, ny, nz = (max(c) + 1 for c in zip(*cells, strict=True))
    order: list[Cell] = []
    for z in range(nz):
        ys = range(ny) if z % 2 == 0 else range(ny - 1, -1, -1)
        for y in ys:
            xs = range(nx) if len(order) // nx % 2 == 0 else range(nx - 1, -1, -1)
            order.extend((x, y, z) for x in xs)
    return order


def solved(cells: frozenset[Cell], rng: np.random.Generator) -> list[Cell] | None:
    """A Hamiltonian path with its ends on the surface, from CP-SAT with a random taste."""
    from ortools.sat.python import cp_model

    order = sorted(cells)
    number = {cell: k + 1 for k, cell in enumerate(order)}
    model = cp_model.CpModel()
    arcs, tastes = [], []
    for cell, k in number.items():
        for normal in NORMALS:
            if plus(cell, normal) in number:
                arcs.append((k, number[plus(cell, normal)], model.new_bool_var("")))
                tastes.append(int(rng.integers(0, 100)) * arcs[-1][2])
        if on_surface(cell, cells):
            arcs += [(0, k, model.new_bool_var("")), (k, 0, model.new_bool_var(""))]
    model.add_circuit(arcs)
    model.minimize(sum(tastes))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = int(rng.integers(1 << 30))
    solver.parameters.max_deterministic_time = 4.0
    if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    follows = {a: b for a, b, used in arcs if solver.boolean_value(used)}
    path, k = [], follows[0]
    while k:
        path.append(order[k - 1])
        k = follows[k]
    return path


# The shapes ---------------------------------------------------------------------------------------

FINDERS = {"blocks": merged_blocks, "exact": solved, "snake": snake}


def drawing(name: str, title: str, finder: str, seed: int, cells: set[Cell]) -> Drawing:
    """A shape to make."""
    return Drawing(name=name, title=title, cells=frozenset(cells), path=FINDERS[finder], seed=seed)


def wrench(head: str, handle: str, rows: int, *, scale: int) -> set[Cell]:
    """Jaws and a straight handle, two cells thick."""
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
    """The file of a shape."""
    cells = shape.path(shape.cells, np.random.default_rng(shape.seed))
    if cells is None:
        raise ValueError(f"no path through {shape.name} with seed {shape.seed}; try another one.")
    path = Path.from_cells(cells, name=shape.name)
    return write_path(path, title=f"{shape.title}, {len(path)} modules")


def main(names: list[str]) -> None:
    """Writes the shapes named, all of them when none is."""
    SHAPES.mkdir(exist_ok=True)
    for shape in DRAWINGS:
        if not names or shape.name in names:
            (SHAPES / f"{shape.name}.json").write_bytes(make(shape))
            print(f"{shape.name}: {len(shape.cells)} modules")


if __name__ == "__main__":
    main(sys.argv[1:])
