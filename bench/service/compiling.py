"""Compiling: processor time for the kernels of a first fold, that fold, and all other kernels."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from typing import Final

from bench.first_minutes import OWN_SHAPE
from bench.sections import Section

MAX_FIRST_CPU_S: Final = 45.0
"""Target of the benchmark: compiling the numerical kernels that a first fold needs takes less
processor time than this, in s. At or above it the target is reported as not met."""
FIRST_KERNELS: Final = """
import sys
from pathlib import Path
from foldback.planner.pipeline.warm_up import warm_up

warm_up(soon=True, directory=Path(sys.argv[1]))
"""
"""Compiles the kernels of a first fold into a directory."""
OWN_FOLD: Final = """
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages

with TemporaryDirectory() as folder:
    data = Path(sys.argv[1]).read_bytes()
    Workspace(Path(folder)).write_request(FoldRequest(filename="own.json"), data)
    assert run_stages(Path(folder))["status"] == "verified"
"""
"""Folds a file."""


def compiling(reference_seconds: float) -> Section:
    """Compile the kernels for a first fold of 24 cubes, run the fold, and compile the others."""
    del reference_seconds
    section = Section(name="compiling")
    with tempfile.TemporaryDirectory(prefix="foldback-kernels-") as cache:
        first = _processor_s(cache, "-c", FIRST_KERNELS, cache)
        fold = _processor_s(cache, "-c", OWN_FOLD, str(OWN_SHAPE))
        processor_s = _processor_s(cache, "-m", "foldback.planner.pipeline.warm_up")
    section.rows.append({"first_s": first, "fold_s": fold, "rest_s": processor_s})
    bar = f"< {MAX_FIRST_CPU_S:.0f} s of the processor"
    section.add("kernels of a first fold", f"{first:.1f} s", bar, first < MAX_FIRST_CPU_S)
    section.add("own fold of 24 cubes then", f"{fold:.1f} s")
    section.add("all other kernels", f"{processor_s:.1f} s")
    return section


def _processor_s(cache: str, *arguments: str) -> float:
    """Return the processor time of a Python process and of those that it waits for, s."""
    before = os.times()
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    subprocess.run([sys.executable, *arguments], env=environment, check=True)
    after = os.times()
    user = after.children_user - before.children_user
    return user + after.children_system - before.children_system
