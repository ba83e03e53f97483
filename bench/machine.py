"""The machine that runs a benchmark, and a reference run to compare its times with."""

from __future__ import annotations

import os
import platform
import resource
import time
from typing import Any

import mujoco

from foldback import Chain, Path
from foldback.planner.simulation.mujoco_models import Material, compiled, tree_spec

REFERENCE_STEPS = 1000
"""Number of MuJoCo time steps of the reference simulation, whose duration on a machine is the unit
(r) in which the benchmarks state times, to compare machines."""
REFERENCE_MODULES = 160
"""Number of cubes of the chain in the reference simulation, whose duration on a machine is the unit
(r) in which the benchmarks state times, to compare machines."""


def machine() -> dict[str, Any]:
    """Return what the figures depend on besides the code: processor, versions, reference time."""
    return {
        "cores": os.cpu_count(),
        "processor": processor(),
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "reference_seconds": reference_seconds(),
        "reference": f"{REFERENCE_STEPS} mj_step of one tree of {REFERENCE_MODULES} cubes",
    }


def reference_seconds() -> float:
    """Return the processor time of a plain MuJoCo run, the same work everywhere, s."""
    cells = [(x, 0, 0) for x in range(REFERENCE_MODULES)]
    spec = tree_spec(Chain.from_path(Path.from_cells(cells)), Material())
    model = compiled(spec)
    data = mujoco.MjData(model)
    start_s = time.process_time()
    for _ in range(REFERENCE_STEPS):
        mujoco.mj_step(model, data)
    return time.process_time() - start_s


def processor_seconds() -> float:
    """Return the processor time of this process and of its ended children, s."""
    used = (
        resource.getrusage(process_kind)
        for process_kind in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def processor() -> str:
    """Return the name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":")[1].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        return platform.processor()
