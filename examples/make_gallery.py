"""Make the shapes of the gallery: `python examples/make_gallery.py [NAME …]`.

`gallery.txt` has drawings of blocks; round and hollow shapes are formulas below. A block becomes
2×2×2 modules, whose path is made by merging the blocks' cycles along a tree. The same seed makes
the same file. `bench/sweeps/gallery.toml` folds them.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path as FilePath

import numpy as np

from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.block_merging import block_path
from foldback.planner.pathfinding.lattice import spread
from foldback.planner.plan.shape_writers import write_path

HERE = FilePath(__file__).parent
HEADING = re.compile(r"([a-z0-9-]+): (.+) \((.+)\) (front|plan) (\d+)")
CANDIDATES = 8
TIMES = re.compile(r"x(\d+)")

Block = tuple[int, int, int]
Inside = Callable[[float, float, float], bool]


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Shape to make: its name, title, tags and blocks, and the seed of its path."""

    name: str
    title: str
    tags: tuple[str, ...]
    blocks: frozenset[Block]
    seed: int = 0


# Drawn shapes -------------------------------------------------------------------------------------


def parse_drawings(text: str) -> Iterator[Drawing]:
    """Yield the shapes of a text in the format that `gallery.txt` explains."""
    for part in text.split("\n\n"):
        heading, *rows = part.strip().splitlines()
        match = HEADING.fullmatch(heading)
        if match:
            name, title, tags, view, seed = match.groups()
            yield Drawing(
                name=name,
                title=title,
                tags=tuple(tags.split()),
                blocks=standing(slices(rows)) if view == "front" else lying(slices(rows)),
                seed=int(seed),
            )


def slices(rows: list[str]) -> list[list[str]]:
    """Return the slices that are drawn side by side, each as often as the number above it says."""
    times = [int(n) for n in TIMES.findall(rows[0])]
    columns = list(zip(*(row.split() for row in rows[bool(times) :]), strict=True))
    return [
        list(column)
        for column, count in zip(columns, times or [1] * len(columns), strict=True)
        for _ in range(count)
    ]


def standing(pictures: list[list[str]]) -> frozenset[Block]:
    """Return the blocks of slices seen from the front: x comes forward, y goes right, z up."""
    return frozenset(
        (x, y, len(picture) - 1 - row)
        for x, picture in enumerate(pictures)
        for row, line in enumerate(picture)
        for y, mark in enumerate(line)
        if mark == "#"
    )


def lying(pictures: list[list[str]]) -> frozenset[Block]:
    """Return the blocks of layers seen from above."""
    return frozenset(
        (x, y, z)
        for z, picture in enumerate(pictures)
        for x, line in enumerate(picture)
        for y, mark in enumerate(line)
        if mark == "#"
    )


# Round and hollow shapes --------------------------------------------------------------------------


def solid(size: Block, inside: Inside) -> frozenset[Block]:
    """Return the blocks of a box whose centres, relative to the centre of the box, are inside."""
    a, b, c = ((n - 1) / 2 for n in size)
    return frozenset(
        (x, y, z) for x, y, z in product(*(range(n) for n in size)) if inside(x - a, y - b, z - c)
    )


# Name, title and tags of each shape, its blocks along x, y and z, and which of them are filled.
FORMULAS: tuple[tuple[str, str, str, Block, Inside], ...] = (
    ("sphere", "Sphere", "solid", (4, 4, 4), lambda x, y, z: x * x + y * y + z * z < 4),
    ("octahedron", "Octahedron", "solid", (5, 5, 5), lambda x, y, z: abs(x) + abs(y) + abs(z) < 3),
    ("cross-3d", "Cross in space", "solid", (5, 5, 5), lambda x, y, z: [x, y, z].count(0) >= 2),
    ("sponge", "Sponge", "solid hollow", (3, 3, 3), lambda x, y, z: [x, y, z].count(0) < 2),
    (
        "hollow-box",
        "Hollow box",
        "hollow",
        (4, 4, 2),
        lambda x, y, z: max(x, -x, y, -y, -3 * z) > 1,
    ),
    ("frame", "Frame", "hollow", (4, 4, 4), lambda x, y, z: sum(abs(v) > 1 for v in (x, y, z)) > 1),
    ("tube", "Tube", "ring hollow", (4, 3, 3), lambda x, y, z: (y, z) != (0, 0)),
    ("ring", "Ring", "ring", (7, 7, 1), lambda x, y, z: 3.5 < x * x + y * y < 10.5),
    ("torus", "Torus", "ring", (6, 6, 2), lambda x, y, z: 3 < x * x + y * y < 9),
    ("nut", "Nut", "ring tool", (5, 5, 2), lambda x, y, z: 1 < abs(x) + abs(y) < 4),
    (
        "picture-frame",
        "Picture frame",
        "ring",
        (1, 6, 5),
        lambda x, y, z: max(y, -y, z + 0.5, 0.5 - z) > 2,
    ),
)


def drawings() -> list[Drawing]:
    """Return all shapes that this script makes."""
    text = (HERE / "gallery.txt").read_text(encoding="utf-8")
    shapes = (
        Drawing(name=name, title=title, tags=tuple(tags.split()), blocks=solid(size, inside))
        for name, title, tags, size, inside in FORMULAS
    )
    return [*parse_drawings(text), *shapes]


# Paths --------------------------------------------------------------------------------------------


def make(shape: Drawing) -> bytes:
    """Return the file of a shape, whose path is the best of several by distance of neighbours."""
    blocks = np.array(sorted(shape.blocks))
    rng = np.random.default_rng(shape.seed)
    cells = min((block_path(blocks, rng) for _ in range(CANDIDATES)), key=spread)
    path = Path.from_cells(cells, name=shape.name)
    tags = json.dumps(shape.tags)
    return write_path(path, title=shape.title).replace(
        b'  "pitch_m"', b'  "tags": ' + tags.encode() + b',\n  "pitch_m"', 1
    )


def main(names: list[str]) -> None:
    """Write the named shapes; all of them if none is named."""
    for shape in drawings():
        if not names or shape.name in names:
            (HERE / "shapes" / f"{shape.name}.json").write_bytes(make(shape))
            print(f"{shape.name}: {8 * len(shape.blocks)} modules")


if __name__ == "__main__":
    main(sys.argv[1:])
