"""Smoothing: figures of plans before and after it, at equal fold times.

``python -m bench.smoothing [SHAPE …]`` prints them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.planner.pipeline.fold import smooth_plan
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan

NAMES = (
    "wrench-24",
    "mallet-64",
    "wrench-94",
    "wrench-160",
    "mallet-192",
    "crown",
    "pot",
    "elephant",
    "tetra-wrench",
    "tetra-slab",
)
"""Shapes of the gallery that are smoothed."""
FEWER = ("frames", "fold_time_s", "length_rad", "peak_torque_nm", "tail_way", "tail_speed")
"""Figures that smoothing should make smaller."""
MORE = ("hinges_moving_mean", "hinges_moving_most", "clearance")
"""Figures that smoothing should make larger."""


def smoothing(reference_seconds: float, shapes: tuple[str, ...] = NAMES) -> Section:
    """Smooth plans of examples with 24 to 384 modules."""
    del reference_seconds
    section = Section(name="smoothing")
    _row("wrench-24")  # import all libraries first
    for shape in shapes:
        section.rows.append(_row(shape))
    rows = section.rows
    for name in (*FEWER, *MORE):
        ratios = [row[name][1] / row[name][0] for row in rows]
        section.add(f"{name}, after / before", f"{np.exp(np.mean(np.log(ratios))):.2f} (geometric)")
    verified = sum(row["verified"] for row in rows)
    section.add("verified", f"{verified} of {len(rows)}", "all", verified == len(rows))
    quieter = sum(row["peak_torque_nm"][1] <= row["peak_torque_nm"][0] for row in rows)
    section.add(
        "peak torque not above", f"{quieter} of {len(rows)}", "most", 2 * quieter > len(rows)
    )
    for row in rows:
        for name, value in row.items():
            if isinstance(value, tuple):
                row[name] = " → ".join(f"{v:.3g}" for v in value)
    return section


def _row(shape: str) -> dict[str, Any]:
    with TemporaryDirectory() as directory:
        Workspace(Path(directory)).write_request(
            FoldRequest(), (SHAPES / f"{shape}.json").read_bytes()
        )
        run_stages(Path(directory))
        recorded = Plan.load(Path(directory) / "plan.npz")
    cpu = time.process_time()
    plan = smooth_plan(recorded)
    cpu = time.process_time() - cpu
    assert plan.smoothing is not None
    before, after = plan.smoothing["before"], plan.smoothing["after"]
    return {
        "shape": shape,
        "modules": len(plan.chain),
        "cpu s": cpu,
        "way": plan.smoothing["way"],
        "verified": plan.verified,
        **{name: (before[name], after[name]) for name in (*FEWER, *MORE)},
    }


def main() -> None:
    """Print the shapes of the command line."""
    smoothing(0.0, tuple(sys.argv[1:]) or NAMES).show(Console(width=260))


if __name__ == "__main__":
    main()
