"""Controllers: a simulated chain, and torques that drive it towards a target."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.setpoints import Target
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import RateMotors, Servos, Tree


def build_plant(trajectory: ReferenceTrajectory) -> tuple[Tree, Callable[[Target], None]]:
    """Return a chain to simulate, and a function that drives it towards a target.

    The function is called after ``begin_step``; it sets torques or motor targets for the step.
    """
    p, step_s = trajectory.parameters, trajectory.step_s
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
