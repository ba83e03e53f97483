"""Joint errors: module sizes for servos of 0.3°, checked with robots that were not used to find it.

``python -m bench.joint_errors [MAX_MODULES]`` folds the gallery's shapes of up to so many modules,
the shortest chains first. Rows and plans are kept in ``out/joint-errors``: a run can be stopped at
any time, and continues where it stopped.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from bench.machine import processor_seconds
from bench.sections import Section
from foldback.planner.clearance.joint_errors import SampledRobots, joint_errors
from foldback.planner.clearance.sweep import sweep
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.gallery import GalleryShape, gallery
from foldback.planner.storage.file_names import PLAN

OUT: Final = Path(__file__).parents[1] / "out" / "joint-errors"
"""Directory of the rows and plans."""
MAX_MODULES: Final = 160
"""Largest number of modules of the chains that are folded."""
JOINT_ERROR: Final = "0.3deg"
"""Error of each hinge for which a module size is found: that of a good servo."""
FRESH_SEED: Final = 1
"""Seed of the errors of robots that check a result; the result itself is found with seed 0."""
REPLAYS: Final = 100
"""Number of robots that check a module size."""
MAX_TOUCHING: Final = 5
"""Bar: at most so many of these touch, with each plan."""
QUANTILE_ROBOTS: Final = 200
"""Number of robots of which 5 % give the sampled error that is compared with the margin."""
MAX_RATIO: Final = 1.5
"""Bar for the sampled error at which 5 % of the robots touch, divided by the margin."""
Row = dict[str, Any]


def joint_error(reference_seconds: float, max_modules: int = MAX_MODULES) -> Section:
    """Fold the gallery's shapes with a joint error, and check what their plans tolerate."""
    del reference_seconds
    OUT.mkdir(parents=True, exist_ok=True)
    path = OUT / "rows.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows: dict[str, Row] = {row["shape"]: row for row in map(json.loads, lines)}
    shapes = [shape for shape in gallery() if shape.modules <= max_modules]
    for shape in shapes:
        if shape.name in rows:
            continue
        rows[shape.name] = row = _row(shape)
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{json.dumps(row)}\n")
        print(row, flush=True)
    return _section([rows[shape.name] for shape in shapes])


def _section(rows: list[Row]) -> Section:
    section = Section(name="joint-error", rows=rows)
    verified = [row for row in rows if row["verified"]]
    sized = [row for row in verified if row["size"] is not None]
    section.add("plans that are verified", f"{len(verified)} of {len(rows)}")
    section.add(f"of these, with a module size for {JOINT_ERROR}", str(len(sized)))
    worst = max((row["touching"] for row in sized), default=0)
    section.add(
        f"most of {REPLAYS} other robots that touch at this size",
        str(worst),
        f"{MAX_TOUCHING}",
        worst <= MAX_TOUCHING,
    )
    ratios = [row["ratio"] for row in verified if row["ratio"] is not None]
    section.add(
        "error at which 5 % of other robots touch, divided by the margin",
        f"{min(ratios):.2f} to {max(ratios):.2f}",
        f"≤ {MAX_RATIO}",
        max(ratios) <= MAX_RATIO,
    )
    estimates = sorted(row["estimate / margin"] for row in verified if row["estimate / margin"])
    section.add(
        "estimate from the folded shape, divided by the margin: median, most",
        f"{estimates[len(estimates) // 2]:.2f}, {estimates[-1]:.2f}",
        f"≤ {MAX_RATIO}",
        estimates[-1] <= MAX_RATIO,
    )
    proved = sorted(row["ratio to proved"] for row in verified if row["ratio to proved"])
    section.add("the same, divided by the proved margin: median", f"{proved[len(proved) // 2]:.1f}")
    return section


def _row(shape: GalleryShape) -> Row:
    """Return the figures of a shape; it is folded unless its plan is there."""
    directory, began_s = OUT / shape.name, processor_seconds()
    if not (directory / PLAN).exists():
        directory.mkdir(exist_ok=True)
        request = FoldRequest(filename=shape.filename, joint_error=JOINT_ERROR)
        Workspace(directory).write_request(request, shape.data)
        run_stages(directory)
    plan = Plan.load(directory / PLAN)
    certificate = plan.certificate
    row: Row = {
        "shape": shape.name,
        "modules": shape.modules,
        "verified": certificate.verified,
        "cpu s of the fold": processor_seconds() - began_s,
    }
    errors = certificate.joint_errors
    if errors is None:
        return {**row, "size": None, "ratio": None, "ratio to proved": None}
    angles, size = plan.motion.angles(plan.chain), certificate.module_size
    fresh = SampledRobots(plan.chain, angles, seed=FRESH_SEED, count=REPLAYS)
    touching = (
        None
        if errors.module_size is None
        else len(fresh.touching(errors.error_rad, errors.module_size))
    )
    quantile = SampledRobots(
        plan.chain,
        angles,
        seed=FRESH_SEED + 1,
        count=QUANTILE_ROBOTS,
    ).largest_error(size, touching=QUANTILE_ROBOTS // 20)
    assert quantile is not None
    margins = certificate.margins
    clearances = sweep(plan.chain, plan.motion, module_size=size).per_frame
    estimate = joint_errors(plan.chain, plan.motion, module_size=size, clearances=clearances)
    assert estimate is not None
    return {
        **row,
        "size": errors.module_size,
        "estimated size": estimate.module_size,
        "estimate / margin": estimate.tolerated_rad / errors.tolerated_rad
        if errors.tolerated_rad
        else None,
        "touching": touching,
        "margin, °": math.degrees(errors.tolerated_rad),
        "sampled 5 %, °": math.degrees(quantile),
        "ratio": quantile / errors.tolerated_rad if errors.tolerated_rad else None,
        "ratio to proved": quantile / margins.independent_rad.value if margins else None,
        "cpu s": processor_seconds() - began_s,
    }


def main() -> None:
    """Run the benchmark with the number of the command line."""
    section = joint_error(0.0, int(sys.argv[1]) if len(sys.argv) > 1 else MAX_MODULES)
    section.show(Console(width=160))


if __name__ == "__main__":
    main()
