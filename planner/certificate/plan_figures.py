"""Plan figures: angles, speeds, torques and end errors of a plan and of its simulated robots."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.certificate.figures import MujocoRobotFigures, RobotFigures
from foldback.planner.certificate.motion_figures import MotionFigures
from foldback.planner.certificate.swept_motions import Sweeps, followed
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2, static_torque
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.clearance.sweep import Sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.playback.playback import Playback

MOVING_SPEED_SHARE: Final = 0.1
"""Minimum speed of a hinge that counts as moving, as a fraction of the fastest hinge's speed at
that time; certificates report the number of moving hinges."""


def plan_figures(chain: Chain, playback: Playback | None, parameters: Parameters) -> dict[str, Any]:
    """Return the chain's torques in gravity, and those figures of a plan that can be computed."""
    figures = _gravity_torques(chain, parameters)
    if playback is None:
        return figures
    plan, times = playback.reference, playback.frames.time_s
    figures["frames"] = len(plan)
    figures["plan_end_error_rad"] = _end_error(chain, plan)
    figures["max_angle_rad"] = max(largest_angle(motion) for motion in followed(playback))
    if playback.simulated:
        figures |= _simulation_figures(chain, playback)
    if len(plan) < 2:
        return figures
    steps, moving = plan.steps(chain, fraction=MOVING_SPEED_SHARE)
    fastest = steps / np.maximum(np.diff(times), 1e-12)
    moving = moving[fastest > 1e-9]
    slower = float(fastest.max()) / parameters.joint_speed_limit_rad_s
    if (hinges := MotionFigures.of(chain, plan)) is not None:
        figures |= asdict(hinges)
    figures["max_joint_step_rad"] = float(steps.max())
    figures["fold_time_s"] = float(times[-1] - times[0]) * slower
    figures["hinges_moving_mean"] = float(moving.mean()) if len(moving) else 0.0
    figures["hinges_moving_most"] = int(moving.max()) if len(moving) else 0
    unit = torque_unit_nm(chain, parameters)
    if parameters.world != "table":  # where weight is most of it, however slowly it is played
        unit /= max(slower, 1e-12) ** 2
    if playback.peak_torque is not None and playback.rms_torque is not None:
        figures["peak_torque_nm"] = playback.peak_torque * unit
        figures["rms_torque_nm"] = playback.rms_torque * unit
        figures["torque_frames"] = playback.torque_frames
        figures["torque_source"] = "simulation, every step"
        if not playback.simulated:
            frames_text = "some" if playback.torque_frames is None else playback.torque_frames
            figures["torque_source"] = (
                f"inverse dynamics at {frames_text} of {len(plan)} frames, accelerations smoothed"
            )
    return figures


def _gravity_torques(chain: Chain, parameters: Parameters) -> dict[str, Any]:
    """Return the largest torques that hold the folded and the straight chain in gravity, N·m."""
    weight = torque_unit_nm(chain, parameters) / chain.pitch_m * GRAVITY_M_S2
    straight_rad = np.zeros_like(chain.folded_rad)
    return {
        "gravity_torque_folded_nm": weight * static_torque(chain, chain.folded_rad),
        "gravity_torque_straight_nm": weight * static_torque(chain, straight_rad),
    }


def _simulation_figures(chain: Chain, playback: Playback) -> dict[str, Any]:
    """Return the end error and the largest joint error of a simulated playback."""
    simulated = playback.frames
    distances = distances_from_shape(chain, simulated.angles_at(chain, -1))
    # The playback says how far off its hinges were at any step; its frames must bear it out.
    off = playback.max_angle_error_rad or 0.0
    off = max(off, _largest_difference(simulated, playback.reference))
    return {
        "rms_position_error": rms(distances),
        "max_position_error": float(distances.max()),
        "max_angle_error_rad": off,
    }


def _end_error(chain: Chain, plan: Motion) -> float:
    return float(np.abs(plan.angles_at(chain, -1) - chain.folded_rad).max(initial=0.0))


def robot_figures(
    chain: Chain, playback: Playback | None, sweeps: Sweeps
) -> tuple[RobotFigures, ...] | None:
    """Return the figures of each robot; None if there are none with model errors."""
    if playback is None or playback.robots is None:
        return None
    motions = followed(playback)[1 : 1 + playback.robots]
    return tuple(
        _figures_of(chain, playback, motion, swept)
        for motion, swept in zip(motions, sweeps.of_robots, strict=False)
        if swept is not None
    )


def mujoco_figures(
    chain: Chain, playback: Playback | None, sweeps: Sweeps
) -> MujocoRobotFigures | None:
    """Return the figures of the robot in MuJoCo; None if there is none."""
    if playback is None or not playback.simulated or playback.mujoco_robot is None:
        return None
    *robots, motion = followed(playback)[1:]
    swept = sweeps.of_robots[-1]
    if swept is None:
        return None
    twin = robots[playback.mujoco_robot]
    return MujocoRobotFigures(
        robot=playback.mujoco_robot,
        max_difference_rad=_largest_difference(motion, twin),
        **_figures_of(chain, playback, motion, swept),
    )


def _figures_of(chain: Chain, playback: Playback, motion: Motion, swept: Sweep) -> RobotFigures:
    """Return the figures of the motion of a robot."""
    return RobotFigures(
        max_angle_error_rad=_largest_difference(motion, playback.reference),
        rms_position_error=rms(distances_from_shape(chain, motion.angles_at(chain, -1))),
        min_clearance=swept.clearance,
        clearance_bound=swept.bound,
    )


def largest_angle(motion: Motion) -> float:
    """Return the largest angle of a hinge in a motion, rad."""
    return float(np.abs(motion.angles_rad).max(initial=0.0))


def _largest_difference(motion: Motion, plan: Motion) -> float:
    """Return the largest difference of a robot's hinges from another motion's frames, rad."""
    return float(np.abs(motion.angles_rad - plan.angles_rad).max(initial=0.0))


def torque_unit_nm(chain: Chain, parameters: Parameters) -> float:
    """Return the unit of simulated torques, module mass · pitch² / s², in N·m."""
    mass_kg = parameters.density_kg_m3 * chain.module.volume * chain.pitch_m**3
    return mass_kg * chain.pitch_m**2


def rms(values: Array) -> float:
    """Return the root of the mean square of values."""
    return float(np.sqrt((values**2).mean()))


def distances_from_shape(chain: Chain, angles: Array) -> Array:
    """Return the (n,) distances of modules from the folded shape, pitches, after alignment."""
    ends = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return aligned_distances(ends.positions, chain.folded_poses.positions)
