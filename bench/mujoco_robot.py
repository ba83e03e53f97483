"""Robots in MuJoCo: their joint errors beside those of our simulation, and what they cost."""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from bench.machine import processor_seconds
from bench.sections import Section
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.robot_run import RobotRun, fold_with_robots
from foldback.planner.playback.robot_runs import mujoco_trajectory
from foldback.planner.progress import never, silent
from foldback.planner.readers.gallery import gallery

SHAPES: Final = (
    *("wrench-24", "box-4x4x4", "cross-3d", "snake", "wrench-160", "duck", "tetra-wrench"),
)
"""Shapes of the gallery whose robots are simulated by both engines."""
MAX_COST: Final = 2.0
"""Bar for the time of the robot of ``wrench-160`` in MuJoCo, in times of the reference: 0.5 s."""


def mujoco_robot(reference_seconds: float) -> Section:
    """Fold shapes of the gallery, and simulate their first robot by both engines."""
    section = Section(name="mujoco-robot")
    section.rows = [
        _row(shape.name, shape.data, reference_seconds)
        for shape in gallery()
        if shape.name in SHAPES
    ]
    for row in section.rows:
        if row["shape"] == "wrench-160":
            cost = row["MuJoCo, × reference"]
            section.add("wrench-160: robot in MuJoCo", f"{cost:.2f} r", "≤ 2 r", cost <= MAX_COST)
    return section


def _row(name: str, data: bytes, reference_seconds: float) -> dict[str, Any]:
    with TemporaryDirectory() as directory:
        place = FilePath(directory)
        workspace = Workspace(place)
        workspace.write_request(FoldRequest(), data)
        run_stages(place)
        chain, record = workspace.read_chain(), workspace.read_record()
        parameters = workspace.read_fold_spec().parameters(record)
    trajectory = ReferenceTrajectory(
        chain, record, parameters.playback, parameters.module_size, 0.0, 1, None
    )
    runs, seconds = list[RobotRun](), list[float]()
    for in_mujoco in (False, True):
        began_s = processor_seconds()
        path = mujoco_trajectory(trajectory) if in_mujoco else trajectory
        if path is None:
            return {"shape": name, "modules": len(chain), "MuJoCo": "takes too long"}
        runs += fold_with_robots(path, [[0, 0]], None, silent, never)
        seconds.append(processor_seconds() - began_s)
    own_run, in_mujoco = runs
    difference = own_run.frames.joint_angles_rad - in_mujoco.frames.joint_angles_rad
    return {
        "shape": name,
        "modules": len(chain),
        "steps": own_run.steps,
        "ours, × reference": seconds[0] / reference_seconds,
        "MuJoCo, × reference": seconds[1] / reference_seconds,
        "error of ours, mrad": 1e3 * own_run.largest_error,
        "error in MuJoCo, mrad": 1e3 * in_mujoco.largest_error,
        "difference, mrad": 1e3 * float(np.abs(difference).max()),
    }
