"""Paths for a table: gallery shapes that have one, search times, and reasons for the others.

``python -m bench.table.paths [CELLS]`` prints them for shapes of up to that many cells.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.sections import Section
from foldback.planner.chain.path import Path as ChainPath
from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.table_paths.rules import LAYERS, rule_violations
from foldback.planner.table_paths.table_paths import TablePath
from tests.planner.table_search import table_paths

SHAPES = Path(__file__).parents[2] / "examples" / "shapes"
"""Directory of the gallery."""
MAX_SHAPE_CELLS = 64
"""Default maximum number of cells of the gallery's shapes for which paths that can fold on a table
are searched; larger shapes are skipped."""
MAX_SEARCH_S = ((64, 2.0), (160, 5.0))
"""Maximum search times, s, of shapes up to a number of cells."""


def table_path_section(reference_seconds: float, *, max_cells: int = MAX_SHAPE_CELLS) -> Section:
    """Search paths through all shapes of cubes in the gallery up to a size."""
    del reference_seconds
    section = Section(name="table-paths")
    shapes = list(gallery_cells(max_cells))
    table_paths(shapes[0][1])  # imports modules that are loaded on first use
    counts = {LAYERS: 0}
    slowest = dict.fromkeys((limit for limit, _ in MAX_SEARCH_S), 0.0)
    for name, cells in shapes:
        start_s = time.perf_counter()
        try:
            paths = table_paths(cells)
            best, none = paths[0], ""
            counts[best.rule] = counts.get(best.rule, 0) + 1
            _check(paths, cells)
        except InputError as error:
            paths, best, none = (), None, f"{error.code}: {error.detail}"
        took = time.perf_counter() - start_s
        for limit in slowest:
            if len(cells) <= limit:
                slowest[limit] = max(slowest[limit], took)
        section.rows.append(
            {
                "shape": name,
                "modules": len(cells),
                "paths": len(paths),
                "down": best.down if best else "",
                "rule": best.rule if best else "",
                "score": best.score if best else "",
                "fall": best.parts.fall if best else "",
                "overhang": best.parts.overhang if best else "",
                "s": took,
                "none because": none,
            }
        )
    by_rule = ", ".join(f"{count} by {rule}" for rule, count in counts.items())
    section.add(
        f"shapes of the gallery up to {max_cells} modules with a path for a table",
        f"{sum(counts.values())} of {len(shapes)}: {by_rule}",
        "reported",
    )
    for limit, seconds in MAX_SEARCH_S:
        if limit <= max(len(cells) for _, cells in shapes):
            section.add(
                f"slowest of those up to {limit} modules",
                f"{slowest[limit]:.2f} s",
                f"≤ {seconds:g} s",
                slowest[limit] <= seconds,
            )
    return section


def gallery_cells(max_cells: int) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Yield names and cells of the gallery's shapes of cubes up to a size."""
    for file in sorted(SHAPES.glob("*.json")):
        result = read(file.read_bytes(), filename=file.name)
        if isinstance(result, ChainPath) and len(result) <= max_cells:
            yield file.stem, result.cells


def _check(paths: tuple[TablePath, ...], cells: NDArray[np.int64]) -> None:
    """Check that paths obey the rules and visit all cells, so that wrong paths give no figures."""
    for path in paths:
        laid = np.unique(cells @ path.turn.T + path.shift, axis=0)
        if rule_violations(path.cells, rule=path.rule) or len(path.cells) != len(cells):
            violations = rule_violations(path.cells, rule=path.rule)
            raise AssertionError(f"a path breaks rules: {violations}")
        if not np.array_equal(np.unique(path.cells, axis=0), laid):
            raise AssertionError("the path does not visit every cell once")


if __name__ == "__main__":
    most = int(sys.argv[1]) if len(sys.argv) > 1 else MAX_SHAPE_CELLS
    table_path_section(1.0, max_cells=most).show(Console(width=200))
