"""Disturbed robots: check that their modules do not touch within the margins of the plan.

``python -m bench.clearance.disturbed_robots [N]`` follows each of ten plans N times (1000) with one
hinge off by its margin, and N times with random errors of all hinges. The clearance of every such
motion is proved over its whole duration. Errors of three and ten times the margin show how much
more a robot tolerates than is proved.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.machine import machine
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.file_names import PLAN

Array = NDArray[np.float64]
PLANS: Final = (
    "wrench-160",
    "cross-3d",
    "box-4x4x4",
    "anchor",
    "duck",
    "guitar",
    "chair",
    "tetra-ring",
    "tetra-wrench",
    "heart",
)
"""Shapes of the gallery; the benchmark folds each with seed 0."""
MARGIN_MULTIPLES: Final = (3.0, 10.0)
"""Multiples of the margin of all hinges that are sampled in addition."""
SAMPLES_PER_LARGE_ERROR: Final = 10
"""Divisor of the number of disturbed motions whose joint errors exceed the permitted ones (3 and 10
times as large). They are sampled less often, as they are only reported."""


def disturbed(section: Section, count: int) -> None:
    """Fold each plan and follow it with errors, ``count`` times for each kind of error."""
    touched = 0
    for name in PLANS:
        row = _row(name, count)
        section.rows.append(row)
        touched += row["one hinge: touch"] + row["at random: touch"]
        print(f"{row}", flush=True)
    section.add("robots within the margins that touch", str(touched), "0", touched == 0)


def _row(name: str, count: int) -> dict[str, Any]:
    path, start_s = SHAPES / f"{name}.json", time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        request = FoldRequest(filename=path.name)
        Workspace(FilePath(folder)).write_request(request, path.read_bytes())
        run_stages(FilePath(folder))
        plan = Plan.load(FilePath(folder) / PLAN)
    margins = plan.certificate.margins
    assert margins is not None, name
    chain, angles = plan.chain, plan.motion.angles(plan.chain)
    size, hinges, rng = plan.certificate.module_size, angles.shape[1], np.random.default_rng(0)
    one_hinge_rad, all_hinges_rad = margins.one_hinge_rad.value, margins.independent_rad.value

    def one_off() -> Array:
        off = np.zeros(hinges)
        off[rng.integers(hinges)] = one_hinge_rad * rng.choice((-1.0, 1.0))
        return off

    def all_off(factor: float) -> Array:
        return rng.uniform(-factor * all_hinges_rad, factor * all_hinges_rad, hinges)

    beyond = {
        f"at random, × {factor:g}: touch, %": 100.0
        * np.mean(
            [
                _touches(chain, angles + all_off(factor), size)
                for _ in range(max(1, count // SAMPLES_PER_LARGE_ERROR))
            ]
        )
        for factor in MARGIN_MULTIPLES
    }
    return {
        "plan": name,
        "modules": len(chain),
        "size": margins.module_size.value,
        "one hinge, °": np.degrees(one_hinge_rad),
        "one hinge: touch": sum(_touches(chain, angles + one_off(), size) for _ in range(count)),
        "at random, °": np.degrees(all_hinges_rad),
        "at random: touch": sum(_touches(chain, angles + all_off(1.0), size) for _ in range(count)),
        **beyond,
        "robots": count,
        "s": time.perf_counter() - start_s,
    }


def _touches(chain: Chain, angles: Array, size: float) -> bool:
    """Return True if a motion is not proved to be free of collisions."""
    return sweep(chain, angles, module_size=size, share=0.0).bound <= 0.0


def main() -> None:
    """Run the benchmark with the number of the command line."""
    section = Section(name="disturbed")
    disturbed(section, int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
    console = Console(width=180)
    console.print(machine())
    section.show(console)


if __name__ == "__main__":
    main()
