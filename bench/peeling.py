"""Peeling: cost and clearance of boxes and solids of growing size.

``python -m bench.peeling [SHAPE …]`` prints them. A box is given as 12x8x12, one whose path comes
from assembled blocks as 12x8x12:blocks, and a solid as ball-16 or cup-12, with its width in cells.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.sections import Section
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.clearance.sweep import sweep
from foldback.planner.explosion.peeling.peeling import peel
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.pathfinding.assembly import assembly_path, layered_snake
from foldback.planner.pathfinding.path_search import find_paths
from foldback.planner.shapes.shape import Shape

SHAPES = ("12x8x12", "12x8x12:blocks", "cup-12", "ball-16", "16x16x16", "20x20x24")
"""Shapes that ``make bench`` peels."""


def peeling(reference_seconds: float, shapes: tuple[str, ...] = SHAPES) -> Section:
    """Peel shapes of 1152 to 9600 modules, and sweep their records."""
    del reference_seconds
    section = Section(name="peeling")
    _run("4x4x4")  # import all libraries first
    for shape in shapes:
        section.rows.append(_run(shape))
    rows = section.rows
    if len({row["modules"] for row in rows}) > 1:
        slope = np.polyfit(
            np.log([row["modules"] for row in rows]), np.log([row["cpu s"] for row in rows]), 1
        )[0]
        section.add("cost ∝ modules^k", f"k = {slope:.2f}", "≤ 1.15", bool(slope <= 1.15))
    straight = sum(row["status"] == "straight" for row in rows)
    section.add("came out straight", f"{straight} of {len(rows)}", "all", straight == len(rows))
    clear = sum(row["clear 0.98"] > 0.0 for row in rows)
    section.add("clear at 0.98", f"{clear} of {len(rows)}", "all", clear == len(rows))
    return section


def _cells(name: str) -> NDArray[np.int64]:
    if "-" in name:
        kind, _, width = name.partition("-")
        return find_paths(Shape.from_cells(_solid(kind, int(width)))).paths[0].cells
    sides, _, blocks = name.partition(":")
    x, y, z = (int(word) for word in sides.split("x"))
    if not blocks:
        return layered_snake((x, y, z))
    coarse = np.argwhere(np.ones((x // 4, y // 4, z // 4), dtype=bool))
    cells = assembly_path(coarse, np.random.default_rng(0), side=4)
    assert cells is not None
    return cells


def _solid(kind: str, width: int) -> NDArray[np.int64]:
    """Return the cells of a ball, or of a cup with a cavity, made of 2×2×2 blocks."""
    coarse = np.argwhere(np.ones((width // 2,) * 3, dtype=bool))
    off = coarse - 0.5 * (width // 2 - 1)
    if kind == "ball":
        inside = (off**2).sum(axis=1) <= 0.25 * (width // 2) ** 2
    else:
        wall = max(1, width // 8)
        inside = (np.abs(off[:, :2]).max(axis=1) > width // 4 - wall) | (coarse[:, 2] < wall)
    corners = np.argwhere(np.ones((2, 2, 2), dtype=bool))
    return (2 * coarse[inside][:, None] + corners).reshape(-1, 3)


def _run(name: str) -> dict[str, Any]:
    cells = _cells(name)
    chain = Chain.from_path(Path.from_cells(cells, name=name))
    cpu = time.process_time()
    record = peel(chain, PeelingParameters())
    cpu = time.process_time() - cpu
    return {
        "shape": name,
        "modules": len(chain),
        "status": record.status,
        "wall s": record.seconds,
        "cpu s": cpu,
        "ms/module": 1e3 * cpu / len(chain),
        "frames": len(record.frames),
        "steps": record.steps,
        "clear 0.95": sweep(chain, record.frames, module_size=0.95).clearance,
        "clear 0.98": sweep(chain, record.frames, module_size=0.98).clearance,
    }


def main() -> None:
    """Print the shapes of the command line."""
    peeling(0.0, tuple(sys.argv[1:]) or SHAPES).show(Console(width=160))


if __name__ == "__main__":
    main()
