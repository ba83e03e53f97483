"""Controllers: a simulated chain, and torques that drive it towards a target."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.setpoints import Target
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_robot import MujocoRobot
from foldback.planner.simulation.mujoco_tree import RateMotors, Servos, Tree
from foldback.planner.simulation.robot import Robot, RobotErrors

Plant = Robot | MujocoRobot | Tree
"""Chain that is simulated step by step, from ``begin_step`` to ``end_step``."""


def build_plant(
    trajectory: ReferenceTrajectory, seed: list[int]
) -> tuple[Plant, Callable[[Target], None]]:
    """Return a chain to simulate, and a function that drives it towards a target.

    The function is called after ``begin_step``; it sets torques or motor targets for the step.
    """
    p, step_s = trajectory.parameters, trajectory.step_s
    if trajectory.by_mujoco:
        errors = RobotErrors(
            trajectory.chain, p.robot, peak_torque=trajectory.peak_torque, seed=seed
        )
        in_mujoco = MujocoRobot(
            trajectory.chain, errors, geom_size=trajectory.module_size, step_s=step_s
        )
        return in_mujoco, lambda target: drive_in_mujoco(in_mujoco, target)
    if trajectory.contacts is not None:
        robot = Robot(
            trajectory.chain,
            trajectory.contacts,
            p.robot,
            peak_torque=trajectory.peak_torque,
            seed=seed,
            step_s=step_s,
        )
        return robot, lambda target: drive_robot(robot, target)
    motors = None
    if p.controller != "computed-torque":
        motors = Servos(stiffness=p.stiffness, damping=p.stiffness / p.motor_gain)
        if p.motor_max_force is not None:
            # The torque of a stiff servo jumps from one limit to the other; a constraint's does
            # not.
            motors = RateMotors(torque_limit=p.motor_max_force)
    material = Material(geom_size=trajectory.module_size, friction=p.friction)
    tree = Tree(trajectory.chain, material, step_s=step_s, motors=motors, damping=p.damping)
    if motors is None:
        return tree, lambda target: drive_by_computed_torque(tree, target, p)
    if isinstance(motors, RateMotors):
        # The rate is proportional to the remaining angle.
        return tree, lambda target: tree.set_rates(
            target.rates + p.motor_gain * (target.angles - tree.angles)
        )
    return tree, lambda target: tree.set_servo_targets(target.angles)


def drive_robot(robot: Robot, target: Target) -> None:
    """Send a robot's servos on, in the coming steps, from a target to the next one."""
    if target.setpoints is not None:
        robot.follow(target.setpoints)


def drive_in_mujoco(robot: MujocoRobot, target: Target) -> None:
    """Send a robot's servos on, in the coming step, through its parts."""
    assert target.substeps is not None
    robot.follow(target.substeps)


def drive_by_computed_torque(tree: Tree, target: Target, p: PlaybackParameters) -> None:
    """Apply inverse dynamics of the floating chain: q̈ = q̈_ref + 2w ė + w² e."""
    w, step = p.bandwidth, p.robot.encoder_step
    angles = np.rint(tree.angles / step) * step if step else tree.angles
    commanded = (
        target.accelerations
        + 2.0 * w * (target.rates - tree.rates)
        + w * w * (target.angles - angles)
    )
    tree.apply_torques(tree.torques_for(commanded))
