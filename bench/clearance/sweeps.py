"""Sweeps: time of a certificate's collision checks, and its growth with the number of modules."""

from __future__ import annotations

import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import Sweep, sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from tests.planner.peels import peel, snake

RECORD_FRAMES = 1000
"""Number of frames to which the motion of a chain of 160 modules is resampled before the time to
prove its clearance is measured. The measured time grows with it."""
SIZES = (0.95, 0.98)
"""Module sizes, as fractions of the pitch; the slower one counts."""
RUNS_PER_SWEEP = 3
"""Number of times that the clearance of each motion is computed; the fastest run counts, as other
processes only slow runs down."""
SNAKES = ((10, 10, 10), (16, 16, 16), (20, 20, 24))
"""Sides of the boxes that are peeled, in cells."""
WINDOW_HINGES, HINGES_PER_FRAME = 200, 1.13
"""Number of hinges of a window, and number by which it advances per frame: about 100 modules move
at the same time, and there are 1.8 frames per module."""


def sweeps(reference_seconds: float) -> Section:
    """Sweep a record of 160 modules with 1000 frames, and peeled boxes of growing size."""
    del reference_seconds
    section = Section(name="swept-motions")
    chain, angles = _recorded()
    worst = max(_row(section, "record of wrench-160", chain, angles, size) for size in SIZES)
    section.add(
        f"160 modules × {RECORD_FRAMES} frames",
        f"{worst:.2f} s",
        "< 2 s (0.3 s)",
        bool(worst < 2.0),
    )
    seconds: list[float] = []
    for sides in SNAKES:
        chain = snake(sides)
        windows = peel(chain, width=WINDOW_HINGES, step=HINGES_PER_FRAME)
        name = "peel of a box, " + "×".join(map(str, sides))
        seconds.append(max(_row(section, name, chain, windows, size) for size in SIZES))
    section.add(
        f"{len(chain)} modules as windows",
        f"{seconds[-1]:.1f} s",
        "< 60 s (10 s)",
        seconds[-1] < 60,
    )
    counts = [int(np.prod(sides)) for sides in SNAKES]
    slope = np.polyfit(np.log(counts), np.log(seconds), 1)[0]
    section.add("cost ∝ modules^k", f"k = {slope:.2f}", "≤ 1.15", bool(slope <= 1.15))
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    section.add("memory of this process", f"{megabytes:.0f} MB", "< 1000 MB", megabytes < 1000)
    return section


def _recorded() -> tuple[Chain, NDArray[np.float64]]:
    """Return the chain and the record of the gallery's wrench, resampled."""
    with TemporaryDirectory() as directory:
        folder = Path(directory)
        Workspace(folder).write_request(FoldRequest(), (SHAPES / "wrench-160.json").read_bytes())
        run_stages(folder)
        record = Record.load(folder / "record.npz").frames.joint_angles_rad
        chain = Plan.load(folder / "plan.npz").chain
    places = np.linspace(0.0, len(record) - 1.0, RECORD_FRAMES)
    below = np.minimum(places.astype(int), len(record) - 2)
    share = (places - below)[:, None]
    return chain, (1.0 - share) * record[below] + share * record[below + 1]


def _row(
    section: Section, name: str, chain: Chain, motion: NDArray[Any] | Motion, size: float
) -> float:
    """Add a row and return its seconds, the minimum of some runs."""
    result, seconds = _timed(chain, motion, size)
    for _ in range(RUNS_PER_SWEEP - 1):
        seconds = min(seconds, _timed(chain, motion, size)[1])
    section.rows.append(
        {
            "motion": name,
            "modules": len(chain),
            "frames": len(motion),
            "size": size,
            "s": seconds,
            "in-betweens": result.in_betweens,
            "clearance": result.clearance,
            "bound": result.bound,
        }
    )
    return seconds


def _timed(chain: Chain, motion: NDArray[Any] | Motion, size: float) -> tuple[Sweep, float]:
    start_s = time.perf_counter()
    computed_sweep = sweep(chain, motion, module_size=size)
    return computed_sweep, time.perf_counter() - start_s
