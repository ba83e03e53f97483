"""Paths: the time to merge blocks into a path, and how many sets of cells are solved exactly.

``python -m bench.paths`` rewrites ``data/*_cells.json``: the digest of each set, its result and the
time that it took.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from bench.feasible_sets import FeasibleSet, feasible_sets
from bench.hard_sets import hard_sets
from bench.sections import Section
from foldback.planner.chain.path import Path as ChainPath
from foldback.planner.pathfinding.block_merging import block_path
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.shapes.shape import Shape

DATA = Path(__file__).parent / "data"
RESULTS = DATA / "exact_cells.json"
HARD_RESULTS = DATA / "hard_cells.json"
MAX_BLOCKS_S = {10_000: 2.0, 100_000: 20.0}
"""Maximum time of a path by blocks, s, by number of modules."""
SIZES = (1_000, 10_000, 100_000, 1_000_000)
"""Numbers of modules of the paths by blocks."""
EXACT_LIMIT_S = 30.0
"""Maximum wall time of the exact search for a path through one set of cells, in s; beyond it the
search gives up and the set counts as unsolved."""
MIN_SOLVED_SHARE = 0.95
"""Target of the benchmark: the exact search finds a path through at least this fraction of the one
hundred sets of cells that certainly have one, each within 30 s. Below it the target is reported as
not met."""
RUNS_PER_SIZE = 3
"""Number of times that a path is built from 2×2×2 blocks for each number of modules; the fastest
run counts, as other processes only slow runs down."""


def paths(reference_seconds: float) -> Section:
    """Measure paths by blocks, the hundred feasible sets, and sets of unknown feasibility."""
    del reference_seconds
    section = Section(name="paths")
    warm = np.argwhere(np.ones((3, 3, 3), dtype=bool))
    exact_path(Shape.from_cells(warm))
    _blocks(section)
    _exact(section)
    _hard(section)
    return section


def _blocks(section: Section) -> None:
    seconds = {size: min(_merge_s(size) for _ in range(RUNS_PER_SIZE)) for size in SIZES}
    for size, took in seconds.items():
        section.rows.append(_row(f"blocks, {size} modules", size, "found", took))
    for size, limit in MAX_BLOCKS_S.items():
        section.add(
            f"path of {size} modules by blocks",
            f"{seconds[size]:.2f} s",
            f"< {limit:g} s",
            seconds[size] < limit,
        )
    large = SIZES[1:]
    slope = np.polyfit(np.log(large), np.log([seconds[size] for size in large]), 1)[0]
    section.add(
        f"cost of blocks ∝ modules^k, {large[0]} to {large[-1]}",
        f"k = {slope:.2f}",
        "about 1",
        bool(slope < 1.3),
    )


def _merge_s(size: int) -> float:
    """Return the seconds for a ball of about the given number of cells."""
    radius = (size / 8 * 3 / (4 * np.pi)) ** (1 / 3)
    reach = np.arange(-int(radius) - 1, int(radius) + 2)
    grid = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), axis=-1).reshape(-1, 3)
    blocks = grid[np.argsort((grid**2).sum(axis=1), kind="stable")[: size // 8]]
    start_s = time.perf_counter()
    cells = block_path(blocks, np.random.default_rng(0))
    took = time.perf_counter() - start_s
    _check(cells, np.unique(cells, axis=0), size)
    return took


def _exact(section: Section) -> None:
    solved, slowest = 0, 0.0
    sets = list(feasible_sets())
    check_stored(sets, RESULTS)
    for feasible_set in sets:
        status, took = _solve(feasible_set)
        good = status == "found" and took < EXACT_LIMIT_S
        solved += good
        slowest = max(slowest, took)
        section.rows.append(_row(feasible_set.name, len(feasible_set.cells), status, took))
    section.add(
        f"feasible sets of 94–300 cells solved within {EXACT_LIMIT_S:g} s",
        f"{solved} of {len(sets)}, the slowest in {slowest:.2f} s",
        f"≥ {100 * MIN_SOLVED_SHARE:g} %",
        solved >= MIN_SOLVED_SHARE * len(sets),
    )


def _hard(section: Section) -> None:
    """Count the sets that are solved, proved to have no path, or left open."""
    sets = list(hard_sets())
    stored = check_stored(sets, HARD_RESULTS)
    counts: Counter[str] = Counter()
    slowest = 0.0
    for feasible_set in sets:
        status, took = _solve(feasible_set)
        if {status, stored[feasible_set.name]} == {"found", "infeasible"}:
            raise AssertionError(
                f"{feasible_set.name} was {stored[feasible_set.name]} and is {status} now"
            )
        counts[status] += 1
        slowest = max(slowest, took)
        section.rows.append(_row(feasible_set.name, len(feasible_set.cells), status, took))
    section.add(
        f"{len(sets)} sets of 94–300 cells that nobody knew",
        f"{counts['found']} solved, {counts['infeasible']} proved to have no path, "
        f"{counts['undecided']} undecided, the slowest in {slowest:.2f} s",
        "reported",
    )


def check_stored(sets: list[FeasibleSet], results: Path) -> dict[str, str]:
    """Check that the sets are those of the stored results; return the stored status of each.

    Raises:
        AssertionError: If a set differs from the one for which its result was stored.
    """
    stored = {row["name"]: row for row in json.loads(results.read_bytes())}
    changed = [
        feasible_set.name
        for feasible_set in sets
        if stored.get(feasible_set.name, {}).get("sha256") != digest(feasible_set)
    ]
    if changed or len(stored) != len(sets):
        raise AssertionError(
            f"{len(changed)} of {len(sets)} sets are not those stored: {changed[:3]}"
        )
    return {name: row["status"] for name, row in stored.items()}


def _solve(feasible_set: FeasibleSet) -> tuple[str, float]:
    start_s = time.perf_counter()
    exact_search = exact_path(Shape.from_cells(feasible_set.cells), time_limit_s=EXACT_LIMIT_S)
    took = time.perf_counter() - start_s
    if exact_search.cells is not None:
        _check(exact_search.cells, feasible_set.cells, len(feasible_set.cells))
    return exact_search.status, took


def _check(path: np.ndarray, cells: np.ndarray, size: int) -> None:
    """Check that a path visits all cells, so that no figure of a wrong path is reported."""
    ChainPath.from_cells(path)
    if len(path) != size or not np.array_equal(np.unique(path, axis=0), cells):
        raise AssertionError("the path does not visit every cell once")


def _row(name: str, size: int, status: str, took: float) -> dict[str, Any]:
    return {"cells of": name, "modules": size, "status": status, "s": took}


def digest(feasible_set: FeasibleSet) -> str:
    """Return a digest of the cells of a set."""
    return hashlib.sha256(feasible_set.cells.astype("<i8").tobytes()).hexdigest()[:16]


def main() -> None:
    """Write the results of all sets."""
    for sets, path in ((feasible_sets(), RESULTS), (hard_sets(), HARD_RESULTS)):
        results: list[dict[str, Any]] = []
        for feasible_set in sets:
            status, took = _solve(feasible_set)
            results.append(
                {
                    "name": feasible_set.name,
                    "cells": len(feasible_set.cells),
                    "sha256": digest(feasible_set),
                    "status": status,
                    "seconds": round(took, 2),
                }
            )
        lines = ",\n".join(json.dumps(result) for result in results)
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
