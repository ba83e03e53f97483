"""Plan files: what a plan of 1000 modules and 3000 frames takes, as JSON and as NumPy arrays."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.interpolate import CubicSpline

from bench.tables import Section
from planner.motion.angle_steps import snapped
from planner.motion.motion import Motion
from planner.parameters.parameters import Parameters
from planner.plan.plan import Plan
from tests.planner.chains import line
from tests.planner.plans import unverified

MODULES, FRAMES = 1000, 3000
KNOTS_EVERY = 10
"""Frames from one control point of the motion to the next: as a simulation's, all hinges move."""
STEP_RAD = 0.03
MOST = 10e6


def plan_files(reference_seconds: float) -> Section:
    """Sizes and times of both forms, of a motion of all hinges."""
    del reference_seconds
    section = Section(name="plan-files")
    plan = _plan()
    with TemporaryDirectory() as place:
        for suffix, write in (("json", plan.save_json), ("npz", plan.save_npz)):
            path = Path(place) / f"plan.{suffix}"
            begun = time.perf_counter()
            write(path)
            written = time.perf_counter()
            again = Plan.load(path)
            read = time.perf_counter()
            same = np.array_equal(again.joint_angles_rad, plan.joint_angles_rad)
            size = path.stat().st_size
            section.rows.append(
                {
                    "form": suffix,
                    "megabytes": round(size / 1e6, 2),
                    "write_s": round(written - begun, 2),
                    "read_s": round(read - written, 2),
                    "same": same,
                }
            )
            section.add(
                f"{MODULES} modules × {FRAMES} frames as {suffix}",
                f"{size / 1e6:.1f} MB",
                "≤ 10 MB, the same numbers",
                same and size <= MOST,
            )
    return section


def _plan() -> Plan:
    chain = line(MODULES)
    random = np.random.default_rng(0)
    knots = np.arange(0, FRAMES + KNOTS_EVERY, KNOTS_EVERY)
    walk = random.normal(scale=STEP_RAD, size=(len(knots), len(chain.folded_rad))).cumsum(axis=0)
    angles = snapped(CubicSpline(knots, np.clip(walk, -1.5, 1.5))(np.arange(FRAMES)))
    frames = Motion.from_frames(
        phase="playback",
        time_s=0.02 * np.arange(FRAMES),
        joint_angles_rad=angles,
        root_position=random.normal(size=(FRAMES, 3)),
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1)),
    )
    return unverified(chain, frames, Parameters())
