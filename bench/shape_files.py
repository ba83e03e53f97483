"""Shapes of benchmarks as files: ``python -m bench.shape_files`` writes those that are missing.

The specs in ``bench/sweeps`` name these files: paths of several kinds through boxes, paths through
random blocks, and meshes.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.path import Path as CellPath
from foldback.planner.core import grow
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pathfinding.block_merging import block_path
from foldback.planner.pathfinding.lattice import STEPS, neighbours
from foldback.planner.pathfinding.path_search import find_paths
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.readers.gallery import shapes_directory
from foldback.planner.shapes.shape import Shape
from foldback.planner.storage.files import write_whole

Ints = NDArray[np.int64]
SHAPES: Final = shapes_directory()
"""Directory of the gallery's shapes."""
FILES: Final = Path(__file__).parent / "sweeps" / "shapes"
"""Directory of the files that this module writes."""
KINDS: Final = ("snake", "assembly", "block", "exact", "random")
"""Kinds of paths through boxes."""
BOXES: Final = {
    32: (2, 4, 4),
    64: (4, 4, 4),
    144: (4, 6, 6),
    288: (6, 6, 8),
    512: (8, 8, 8),
    1152: (8, 12, 12),
    4096: (16, 16, 16),
}
"""Sides of the boxes, in cells, by number of modules."""
PATHS_PER_BOX: Final = 5
"""Number of paths of each kind through a box, with different seeds."""
MAX_MODULES_OF_SEVERAL: Final = 512
"""Number of modules above which a box has only one path of each kind."""
MOVES_PER_MODULE: Final = 2000
"""Maximum number of random moves (backbite moves, which extend a path or turn its end) per module
in which a random path must fill its box; otherwise there is no path."""
RANDOM_PATHS: Final = 20
"""Number of paths through random blocks."""
BLOCKS_PER_PATH: Final = 20
"""Number of 2×2×2 blocks of cells of which each random path consists: 160 modules, as in the
paper's wrench."""


def path_of(kind: str, sides: tuple[int, int, int], seed: int) -> Ints | None:
    """Return the (n, 3) cells of a box in the order of a path of a kind; None if none is found."""
    box = np.argwhere(np.ones(sides, dtype=bool))
    if kind == "snake":
        x, y, z = np.roll(sides, seed).tolist()
        return layered_snake((x, y, z))
    if kind == "random":
        count, order = grow(
            neighbours(box), np.ones(len(box), dtype=bool), -1, MOVES_PER_MODULE * len(box), seed
        )
        return box[order] if count == len(box) else None
    method = "blocks" if kind == "block" else kind
    found_paths = find_paths(Shape.from_cells(box), method=method, seed=seed, candidates=1).paths
    return found_paths[0].cells if found_paths else None


def path_file(cells: Ints, name: str = "box") -> bytes:
    """Return the file of a path through (n, 3) cells."""
    return write_path(CellPath.from_cells([tuple(cell) for cell in cells.tolist()], name=name))


def random_blocks(seed: int) -> Ints:
    """Return the cells of a path through blocks, each next to one of those before it."""
    rng = np.random.default_rng(seed)
    blocks = [(0, 0, 0)]
    while len(blocks) < BLOCKS_PER_PATH:
        beside = np.add(blocks[int(rng.integers(len(blocks)))], STEPS[int(rng.integers(6))])
        x, y, z = beside.tolist()
        if (x, y, z) not in blocks:
            blocks.append((x, y, z))
    return block_path(np.array(blocks, dtype=np.int64), rng, tree="random")


def write_shapes(directory: Path = FILES) -> None:
    """Write the files that a directory lacks; numbers at the ends of their names are seeds."""
    from bench.meshes import MESHES  # imported late: others need no trimesh

    directory.mkdir(parents=True, exist_ok=True)
    for modules, sides in BOXES.items():
        seeds = range(1 if modules > MAX_MODULES_OF_SEVERAL else PATHS_PER_BOX)
        for kind, seed in product(KINDS, seeds):
            file = directory / f"{kind}-{modules}-{seed}.json"
            if not file.exists() and (cells := path_of(kind, sides, seed)) is not None:
                write_whole(file, path_file(cells))
    for seed in range(RANDOM_PATHS):
        write_whole(directory / f"blocks-160-{seed}.json", path_file(random_blocks(seed)))
    for name, make in MESHES.items():
        mesh: Any = make()
        write_whole(directory / f"{name}.stl", mesh.export(file_type="stl"))


if __name__ == "__main__":
    write_shapes()
