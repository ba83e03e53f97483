"""Make the gallery's chains of tetrahedra: `python examples/make_tetrahedra.py`.

Each cell of a shape becomes a ring of twelve tetrahedra; one trail goes through all of them. The
same script makes the same files. `bench/sweeps/gallery.toml` folds them.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import dodecahedron_pairs
from foldback.planner.chain.trail import Trail
from foldback.planner.pathfinding.eulerian_circuits import cut_open, eulerian_circuit
from foldback.planner.pathfinding.trail_search import find_trails
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.shapes.shape import Shape

HERE = Path(__file__).parent
Cells = list[tuple[int, ...]]


def box(a: int, b: int, c: int) -> Cells:
    """Return all cells of a box."""
    return list(product(range(a), range(b), range(c)))


def picture(*rows: str) -> Cells:
    """Return the cells of a picture: y to the right, z upward."""
    return [
        (0, y, len(rows) - 1 - z)
        for z, row in enumerate(rows)
        for y, mark in enumerate(row)
        if mark == "#"
    ]


SHAPES: tuple[tuple[str, str, tuple[str, ...], Cells], ...] = (
    ("tetra-ring", "Ring of twelve", ("tetrahedra", "ring"), box(1, 1, 1)),
    ("tetra-bar", "Bar", ("tetrahedra", "solid"), box(8, 1, 1)),
    ("tetra-cube-2", "Cube 2×2×2", ("tetrahedra", "solid"), box(2, 2, 2)),
    ("tetra-cube-3", "Cube 3×3×3", ("tetrahedra", "solid"), box(3, 3, 3)),
    ("tetra-slab", "Slab 4×4×2", ("tetrahedra", "solid"), box(4, 4, 2)),
    (
        "tetra-wrench",
        "Wrench",
        ("tetrahedra", "tool"),
        picture("##........", ".##.......", "..########", ".##.......", "##........"),
    ),
    (
        "tetra-mallet",
        "Mallet",
        ("tetrahedra", "tool"),
        [*((0, y, 1) for y in range(8)), *((x, 8 + y, z) for x, y, z in box(1, 2, 4))],
    ),
    ("tetra-frame", "Square ring", ("tetrahedra", "ring"), picture("####", "#..#", "#..#", "####")),
    (
        "tetra-letter-f",
        "Letter F",
        ("tetrahedra", "letter"),
        picture("###", "#..", "##.", "#..", "#.."),
    ),
)


def main() -> None:
    """Write the files."""
    for name, title, tags, cells in SHAPES:
        trail = find_trails(Shape.from_cells(np.array(cells), name=name)).trails[0]
        save(name, title, tags, trail)
    ring = cut_open(eulerian_circuit(dodecahedron_pairs(np.zeros((1, 3), dtype=np.int64))), 0)
    trail = Trail.from_nodes(ring, name="tetra-dodecahedron")
    save(trail.name, "Rhombic dodecahedron", ("tetrahedra", "solid"), trail)


def save(name: str, title: str, tags: tuple[str, ...], trail: Trail) -> None:
    """Write the chain of a trail."""
    data = write_chain(Chain.from_trail(trail), title=title, tags=tags)
    (HERE / "shapes" / f"{name}.json").write_bytes(data)


if __name__ == "__main__":
    main()
