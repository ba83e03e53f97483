"""Retime task: computes trajectories of plans in a child, for ``server/files/trajectories.py``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from foldback.planner.exports.trajectory import MAX_TOUCH_DEPTH_PITCH, sufficient_rate
from foldback.planner.exports.trajectory import clearance as clearance_of_rows
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.file_names import PLAN
from foldback.planner.trajectories.motors import Build, motor_requirements
from foldback.planner.trajectories.retiming import retime as retime_plan
from foldback.planner.trajectories.trajectory import Trajectory
from foldback.server.processes.scratch import MOTORS_FILE, request_in


def retime(directory: Path) -> dict[str, Any]:
    """Write the trajectory that ``request.json`` describes; return facts of its plan.

    Raises:
        InputError: If the plan cannot be retimed.
    """
    plan, trajectory = _retimed(directory, request_in(directory))
    trajectory.save(directory)
    return {"name": plan.chain.name, "verified": plan.verified}


def clearance(directory: Path) -> dict[str, Any]:
    """Return the clearance of a trajectory's rows at the rate in ``request.json``.

    If the rows overlap, ``sufficient_rate_hz`` is a rate at which they are proved clear.

    Raises:
        InputError: If the plan cannot be retimed or the rate is invalid.
    """
    request = request_in(directory)
    plan, trajectory = _retimed(directory, request)
    size, rate_hz = plan.certificate.module_size, request["rate_hz"]
    end = time.process_time() + 5.0  # 160 modules take less than 1 s, 1000 about 15 s

    def late() -> bool:
        return time.process_time() > end

    clearances = clearance_of_rows(
        trajectory, plan.chain, module_size=size, rate_hz=rate_hz, cancelled=late
    )
    enough = None
    if clearances.clearance < -MAX_TOUCH_DEPTH_PITCH and rate_hz is not None:
        enough = sufficient_rate(
            trajectory, plan.chain, module_size=size, rate_hz=rate_hz, cancelled=late
        )
    return {
        "min_clearance": clearances.clearance,
        "clearance_bound": clearances.bound,
        "overlap": clearances.clearance < -MAX_TOUCH_DEPTH_PITCH,
        "sufficient_rate_hz": enough,
    }


def motors(directory: Path) -> dict[str, Any]:
    """Write the table of motors that ``request.json`` describes, as JSON or CSV.

    Raises:
        InputError: If the plan cannot be retimed or the motor data are invalid.
    """
    request = request_in(directory)
    plan, trajectory = _retimed(directory, request)
    chain, pitch_m = plan.chain, request["pitch_m"]
    build = Build(
        module_mass_kg=request["module_mass_kg"],
        pitch_m=chain.pitch_m if pitch_m is None else pitch_m,
        gravity_m_s2=request["gravity_m_s2"],
        held=request["held"],
    )
    motors = motor_requirements(
        chain, trajectory, build, motor_torque_nm=request["motor_torque_nm"]
    )
    text = motors.as_csv() if request["form"] == "csv" else json.dumps(motors.as_dict())
    (directory / MOTORS_FILE).write_text(text)
    return {}


def _retimed(directory: Path, request: dict[str, Any]) -> tuple[Plan, Trajectory]:
    plan = Plan.load(directory / PLAN)
    return plan, retime_plan(plan, request["max_speed"], request["max_acceleration"])
