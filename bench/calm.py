"""Calm motion: how the hinges of default folds move, compared with explosions that are not calm.

``python -m bench.calm [MAX_MODULES]`` folds only chains of up to so many cubes; 80 take about a
minute of the processor.
"""

from __future__ import annotations

import sys
from math import prod
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from rich.console import Console

from bench.machine import processor_seconds
from bench.sections import Section
from bench.shape_files import path_file, path_of
from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.explosion.simultaneous import MAX_STRAIGHT_HINGE_RAD
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.gallery import gallery

MAX_MODULES: Final = 160
"""Largest number of cubes of the chains that are folded."""
RANDOM_BOXES: Final = ((4, 4, 4), (4, 4, 6), (4, 5, 6), (4, 6, 6), (4, 4, 10))
"""Sides of the boxes, in cells, that are also folded along a random path each."""
STRATEGIES: Final = ("auto", "simultaneous")
"""Strategies that are compared: the default, turns or a calm explosion, and the explosion that is
not calm."""
MAX_MEDIAN_TRAVEL: Final = 1.6
"""Bar for the median travel of default folds, relative to the least."""
COMPARED: Final = ("travel", "moving mean", "moving max", "reversals", "held", "bound", "cpu s")
"""Figures whose medians are compared."""


def calm(reference_seconds: float, max_modules: int = MAX_MODULES) -> Section:
    """Fold gallery shapes and random paths by default, and with the explosion that is not calm."""
    section = Section(name="calm")
    shapes = [
        (shape.name, shape.data)
        for shape in gallery()
        if shape.module == CUBE.name and shape.modules <= max_modules
    ]
    shapes += [
        (f"random {sides}", _random_path(sides))
        for sides in RANDOM_BOXES
        if prod(sides) <= max_modules
    ]
    runs = {
        strategy: [_row(name, data, strategy, reference_seconds) for name, data in shapes]
        for strategy in STRATEGIES
    }
    verified: dict[str, list[dict[str, Any]]] = {}
    for strategy, rows in runs.items():
        verified[strategy] = [row for row in rows if row["verified"]]
        first = sum(row["attempts"] == 1 for row in verified[strategy])
        text = f"{len(verified[strategy])} of {len(rows)}, {first} at the first attempt"
        section.add(f"verified, {strategy}", text)
    for name in COMPARED:
        after, before = (
            float(np.median([row[name] for row in verified[strategy]])) for strategy in STRATEGIES
        )
        text = f"{after:.3g} instead of {before:.3g}"
        if name == "travel":
            bar = f"at most {MAX_MEDIAN_TRAVEL}"
            section.add(f"{name}, median", text, bar, after <= MAX_MEDIAN_TRAVEL)
        else:
            section.add(f"{name}, median", text)
    section.rows = [row for pair in zip(*runs.values(), strict=True) for row in pair]
    return section


def _random_path(sides: tuple[int, int, int]) -> bytes:
    """Return the file of a random path through all cells of a box."""
    cells = path_of("random", sides, 0)
    assert cells is not None, f"a box of {sides} has random paths"
    return path_file(cells)


def _row(name: str, data: bytes, strategy: str, reference_seconds: float) -> dict[str, Any]:
    before_s = processor_seconds()
    with TemporaryDirectory() as scratch:
        directory = FilePath(scratch)
        request = FoldRequest(filename="path.json", strategy=strategy)
        Workspace(directory).write_request(request, data)
        run_stages(directory, workers=1)
        plan = Plan.load(directory / "plan.npz")
    seconds = processor_seconds() - before_s
    certificate = plan.certificate
    straight = int((np.abs(plan.chain.folded_rad) < MAX_STRAIGHT_HINGE_RAD).sum())
    return {
        "shape": name,
        "modules": len(plan.chain),
        "asked": strategy,
        "strategy": plan.attempts[-1]["strategy"],
        "attempts": len(plan.attempts),
        "verified": certificate.verified,
        "verdict": certificate.verdict,
        "travel": certificate.travel_ratio,
        "moving mean": certificate.hinges_moving_mean,
        "moving max": certificate.hinges_moving_most,
        "reversals": certificate.reversals_mean,
        "straight": straight,
        "held": None if certificate.detours is None else straight - certificate.detours,
        "bound": certificate.clearance_bound,
        "fold s": certificate.fold_time_s,
        "torque N·m": certificate.peak_torque_nm,
        "cpu s": round(seconds, 2),
        "ratio": round(seconds / reference_seconds, 2) if reference_seconds else None,
    }


def main() -> None:
    """Print the shapes up to the number of cubes of the command line."""
    calm(0.0, int(sys.argv[1]) if len(sys.argv) > 1 else MAX_MODULES).show(Console(width=200))


if __name__ == "__main__":
    main()
