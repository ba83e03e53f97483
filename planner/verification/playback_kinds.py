"""Playback kinds: a check that a playback was simulated, or was not, as its plan states.

The kind follows from the chain, its record and the parameters; each kind has figures of its own,
which are compared with the frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from foldback.planner.motion.inverse_dynamics import inverse_dynamics
from foldback.planner.parameters.playback import TablePlaybackParameters
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    SINGLE_PRECISION_ATOL_RAD,
    Differences,
    array_difference,
    figure_differences,
    value_differences,
)
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.simulation_work import is_simulated
from foldback.planner.playback.table_playback import time_unit_s
from foldback.planner.verification.plan_parameters import (
    is_on_table,
    plan_parameters,
    plan_preset,
    playback_number,
)


def kind_differs(plan: Plan, playback: Playback) -> Differences:
    """Yield the differences of a playback from the expected kind, and from the figures of it.

    The expected kind follows from the chain, its record, and the parameters.
    """
    expects_explosion = plan_preset(plan).explosion is not None
    if expects_explosion != (plan.explosion is not None):
        need = "null, expected results" if expects_explosion else "results, expected null"
        yield f"plan.npz explosion: got {need}, because the preset is {plan.preset}"
    direct = plan.explosion is None and not plan.motion.is_windowed
    simulated = direct or _is_simulated(plan)
    kind = "dynamic" if simulated else "kinematic"
    yield from value_differences(playback.kind, kind, "plan.npz playback.kind")
    if simulated:
        yield from _simulated_figures(plan, playback)
    else:
        yield from _kinematic_figures(plan, playback)


def _is_simulated(plan: Plan) -> bool:
    """Return True if the parameters of a plan, and the frames of its record, ask for robots."""
    playback, usual = plan.parameters["playback"], plan_preset(plan).playback
    limit = playback.get("simulated_modules", usual.simulated_modules)
    robots = playback.get("robot", {}).get("robots", usual.robot.robots)
    return is_simulated(
        len(plan.chain),
        int((plan.explosion or {}).get("frames") or 0),
        None if limit is None else int(playback_number(plan, "simulated_modules")),
        int(robots),
        is_windowed=plan.motion.is_windowed,
    )


def _simulated_figures(plan: Plan, playback: Playback) -> Differences:
    """Yield the figures of a simulation that its frames contradict."""
    yield from value_differences(playback.torque_frames, None, "plan.npz playback.torque_frames")
    if playback.status not in ("folded", "missed"):  # it broke off between two frames
        return
    max_error = float(np.nanmax(plan.max_error_rad, initial=0.0))
    if playback.status == "folded" and not max_error <= (playback.max_angle_error_rad or 0.0) * (
        1 + SINGLE_PRECISION_ATOL_RAD
    ):
        yield (
            f"plan.npz playback.max_angle_error_rad: got {playback.max_angle_error_rad}, expected "
            f"at least {max_error}, the largest error in a frame"
        )
    summary = playback.summary()
    for name in ("rms_position_error", "max_angle_error_rad", "peak_torque", "rms_torque"):
        if summary[name] is None:
            yield (
                f"plan.npz playback.{name}: got null, expected a number, because the playback was "
                "simulated"
            )
    steps = float(np.diff(plan.time_s).sum()) / _step_s(plan)
    if not abs(playback.steps - steps) <= 1e-3:  # rounding
        yield f"plan.npz playback.steps: got {playback.steps}, expected {steps:.9g}"
    played, reference = playback.frames, playback.reference
    moves = reference.steps(plan.chain)[0].any()
    if not np.isfinite(played.errors).all():
        yield (
            "the timeline's joint errors: got undefined numbers, expected those of a simulated "
            "robot"
        )
    if moves and np.array_equal(played.angles_rad, reference.angles_rad):
        yield (
            "the timeline's joint angles: got exactly those of plan.npz, expected those of a "
            "simulation, which always differ"
        )


def _step_s(plan: Plan) -> float:
    """Return the time step of a plan's simulation, s."""
    if is_on_table(plan):
        is_clamped = plan_parameters(plan, None).table.held
        return time_unit_s(plan.chain) * TablePlaybackParameters.usual(clamped=is_clamped).step
    return playback_number(plan, "step_s")


def _kinematic_figures(plan: Plan, playback: Playback) -> Differences:
    """Yield the differences of the figures of a kinematic playback from its frames."""
    torques = inverse_dynamics(plan.chain, playback.frames)
    looked = len(torques.frames)
    expected: dict[str, Any] = {
        "peak_torque": torques.peak if looked else None,
        "rms_torque": torques.rms if looked else None,
        "torque_frames": looked,
        **{"status": "folded", "reason": None, "steps": 0},
        **{"rms_position_error": None, "max_angle_error_rad": None},
    }
    none = np.full(len(plan.max_error_rad), np.nan)
    yield from array_difference(plan.max_error_rad, none, "plan.npz max_error_rad")
    summary = playback.summary()
    yield from figure_differences(
        {name: summary[name] for name in expected},
        expected,
        "plan.npz playback",
    )
