"""Plan files: size and time to write and read a plan of 1000 modules as JSON, npz and timeline."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.interpolate import CubicSpline

from bench.sections import Section
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.plan.plan import Plan
from tests.planner.chains import line
from tests.planner.plans import unverified

PLAN_MODULES, PLAN_FRAMES = 1000, 3000
"""Number of modules, and of frames, of the plan."""
FRAMES_PER_KNOT = 10
"""Number of frames between two control points of the spline that gives the artificial motion of the
measured plan, so that all hinges move smoothly as in a simulation."""
KNOT_STEP_RAD = 0.03
"""Standard deviation of the random change of a hinge's angle between two control points of the
artificial motion of the measured plan, in rad."""
MAX_PLAN_FILE_BYTES = 10e6
"""Target of the benchmark: a plan of 1000 modules and 3000 frames is stored in at most this many
bytes, as JSON and as npz. Above it the target is reported as not met."""


def plan_files(reference_seconds: float) -> Section:
    """Measure sizes and times of all formats, for a motion of all hinges."""
    section = Section(name="plan-files")
    plan = _plan()
    with TemporaryDirectory() as place:
        for suffix, write in (("json", plan.save_json), ("npz", plan.save_npz)):
            path = Path(place) / f"plan.{suffix}"
            start_s = time.perf_counter()
            write(path)
            written = time.perf_counter()
            second_plan = Plan.load(path)
            read = time.perf_counter()
            same_array_equal = np.array_equal(second_plan.joint_angles_rad, plan.joint_angles_rad)
            size = path.stat().st_size
            section.rows.append(
                {
                    "form": suffix,
                    "megabytes": round(size / 1e6, 2),
                    "write_s": round(written - start_s, 2),
                    "read_s": round(read - written, 2),
                    "same": same_array_equal,
                }
            )
            section.add(
                f"{PLAN_MODULES} modules × {PLAN_FRAMES} frames as {suffix}",
                f"{size / 1e6:.1f} MB",
                "≤ 10 MB, the same numbers",
                same_array_equal and size <= MAX_PLAN_FILE_BYTES,
            )
        _measure_timeline(section, plan, Path(place) / "timeline", reference_seconds)
    return section


def _measure_timeline(section: Section, plan: Plan, path: Path, reference_seconds: float) -> None:
    """Add the size of a timeline, and processor times to write and read it."""
    start_s = time.process_time()
    with TimelineWriter.create(path, plan.chain) as writer:
        writer.append(plan.motion)
    written = time.process_time()
    motion = Timeline.open(path).motion()
    read = time.process_time()
    Timeline.open(path).motion(PLAN_FRAMES // 2, PLAN_FRAMES // 2 + 1)
    read_one = time.process_time()
    section.rows.append(
        {
            "form": "timeline",
            "megabytes": round(sum(file.stat().st_size for file in path.iterdir()) / 1e6, 2),
            "write_s": round(written - start_s, 2),
            "read_s": round(read - written, 2),
            "same": motion.passes_as(plan.motion),
        }
    )
    section.add(
        "timeline of it written; one frame read",
        f"{(written - start_s) / reference_seconds:.2f} r; {1e3 * (read_one - read):.1f} ms",
    )


def _plan() -> Plan:
    chain = line(PLAN_MODULES)
    random = np.random.default_rng(0)
    knots = np.arange(0, PLAN_FRAMES + FRAMES_PER_KNOT, FRAMES_PER_KNOT)
    size = (len(knots), len(chain.folded_rad))
    walk = random.normal(scale=KNOT_STEP_RAD, size=size).cumsum(axis=0)
    angles = quantised(CubicSpline(knots, np.clip(walk, -1.5, 1.5))(np.arange(PLAN_FRAMES)))
    frames = Motion.from_frames(
        phase="playback",
        time_s=0.02 * np.arange(PLAN_FRAMES),
        joint_angles_rad=angles,
        root_position=random.normal(size=(PLAN_FRAMES, 3)),
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (PLAN_FRAMES, 1)),
    )
    return unverified(chain, frames, Parameters())
