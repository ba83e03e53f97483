"""Portfolio: hard folds, whose attempts are made one after the other and in parallel.

``python -m bench.portfolio [FOLD …]`` prints them: ``knot`` (a thick trefoil of 71 modules, whose
first attempt is verified) and ``torus`` (1000 modules of a mesh at size 0.98, peeling stalls).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

import trimesh
from rich.console import Console

from bench.machine import processor_seconds
from bench.sections import Section
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from tests.planner.chains import knotted

FOLDS = ("knot", "torus")
WORKERS = (1, 2)
"""Numbers of worker processes with which each fold is run."""


def portfolio(reference_seconds: float, folds: tuple[str, ...] = FOLDS) -> Section:
    """Run each fold with one worker and with two."""
    del reference_seconds
    section = Section(name="portfolio")
    for name in folds:
        rows = [_run(name, workers) for workers in WORKERS]
        plans = [row.pop("plan") for row in rows]
        section.rows += rows
        first, two = rows
        section.add(f"{name}: wall, two workers to one", f"{two['wall s'] / first['wall s']:.2f}")
        section.add(f"{name}: processor, two to one", f"{two['cpu s'] / first['cpu s']:.2f}")
        is_same = plans[0] == plans[1]
        section.add(f"{name}: the same plan", "yes" if is_same else "no", "yes", is_same)
    return section


def _asked(name: str) -> tuple[FoldRequest, bytes]:
    if name == "knot":
        return FoldRequest(filename="knot.json"), write_chain(knotted())
    solid = trimesh.creation.torus(major_radius=1.0, minor_radius=0.4)
    data = solid.export(file_type="stl")
    assert isinstance(data, bytes)
    return FoldRequest(filename="torus.stl", modules=1000, module_size=0.98), data


def _run(name: str, workers: int) -> dict[str, Any]:
    with TemporaryDirectory() as place:
        directory = FilePath(place)
        Workspace(directory).write_request(*_asked(name))
        wall, cpu = time.perf_counter(), processor_seconds()
        summary = run_stages(directory, workers=workers)
        wall, cpu = time.perf_counter() - wall, processor_seconds() - cpu
        plan = Plan.load(directory / "plan.npz")
        try_seconds = [attempt["seconds"] for attempt in plan.attempts if "finer" not in attempt]
        return {
            "fold": name,
            "workers": workers,
            "modules": summary["modules"],
            "status": summary["status"],
            "tries": len(try_seconds),
            "seconds of each": " ".join(f"{seconds:.1f}" for seconds in try_seconds),
            "wall s": wall,
            "cpu s": cpu,
            "plan": [value.tobytes() for value in plan.motion.columns().values()],
        }


def main() -> None:
    """Run the folds of the command line."""
    portfolio(0.0, tuple(sys.argv[1:]) or FOLDS).show(Console(width=160))


if __name__ == "__main__":
    main()
