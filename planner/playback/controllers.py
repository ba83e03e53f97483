"""Controllers: a simulated chain, and torques that drive it towards a target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.parameters.playback import PlaybackParameters
from planner.playback.reference_trajectory import ReferenceTrajectory
from planner.playback.setpoints import Target
from planner.simulation.mujoco_models import Material
from planner.simulation.mujoco_tree import RateMotors, Servos, Tree
from planner.simulation.robot import Robot

Array = NDArray[np.float64]


class Plant(Protocol):
    """Chain that is simulated step by step, from ``begin_step`` to ``end_step``."""

    @property
    def angles(self) -> Array:
        """(J,) hinge angles, rad."""
        ...

    @property
    def rates(self) -> Array:
        """(J,) hinge velocities, rad/s."""
        ...

    @property
    def centres(self) -> Array:
        """(n, 3) centres of the modules relative to their mean, pitches."""
        ...

    @property
    def root_position(self) -> Array:
        """(3,) centre of the root, pitches."""
        ...

    @property
    def root_wxyz(self) -> Array:
        """(4,) orientation of the root, w first."""
        ...

    @property
    def motor_torques(self) -> Array:
        """(J,) motor torques in the last step."""
        ...

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Set a configuration at rest."""
        ...

    def begin_step(self) -> None:
        """Compute the part of a step that depends on positions and velocities alone."""
        ...

    def end_step(self) -> None:
        """Finish a step; raise ``SimulationError`` if the state is not finite."""
        ...

    def stop_drifting(self) -> None:
        """Remove the momentum that integration has added."""
        ...


class Controller(Protocol):
    """Law that drives the hinges of a tree towards a target in the coming step."""

    def drive(self, tree: Tree, target: Target) -> None:
        """Set torques or motor targets. ``tree.begin_step`` has been called."""
        ...


def drive_robot(robot: Robot, target: Target, step_s: float) -> None:
    """Send a robot's servos on, in the coming step, from a target to the next one."""
    assert target.torques is not None
    rates = target.rates + step_s * target.accelerations
    robot.follow(target.angles + step_s * rates, rates, target.torques)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComputedTorque:
    """Computed-torque law: inverse dynamics of the floating chain, q̈ = q̈_ref + 2w ė + w² e.

    Attributes:
        bandwidth: w, 1/s.
        encoder_rad: Resolution of the hinges' encoders, rad; 0 for exact ones.
    """

    bandwidth: float
    encoder_rad: float

    def drive(self, tree: Tree, target: Target) -> None:
        """Set torques or motor targets, see ``Controller``."""
        w, step = self.bandwidth, self.encoder_rad
        angles = np.rint(tree.angles / step) * step if step else tree.angles
        wanted = (
            target.accelerations
            + 2.0 * w * (target.rates - tree.rates)
            + w * w * (target.angles - angles)
        )
        tree.apply_torques(tree.torques_for(wanted))


class Servo:
    """Servo of the paper with motors of no limit: position actuators that pull to the target."""

    def drive(self, tree: Tree, target: Target) -> None:
        """Set torques or motor targets, see ``Controller``."""
        tree.set_servo_targets(target.angles)


@dataclass(frozen=True, slots=True, kw_only=True)
class RateServo:
    """Servo of the paper: rate motors that turn at a rate proportional to the remaining angle.

    Attributes:
        gain: Rate per radian of error, 1/s.
    """

    gain: float

    def drive(self, tree: Tree, target: Target) -> None:
        """Set torques or motor targets, see ``Controller``."""
        tree.set_rates(target.rates + self.gain * (target.angles - tree.angles))


def build_plant(
    trajectory: ReferenceTrajectory, seed: list[int]
) -> tuple[Plant, Callable[[Target], None]]:
    """Return a chain to simulate, and a function that drives it towards a target."""
    p, step_s = trajectory.parameters, trajectory.step_s
    if trajectory.contacts is not None:
        robot = Robot(
            trajectory.chain,
            trajectory.contacts,
            p.robot,
            peak_torque=trajectory.peak_torque,
            seed=seed,
            step_s=step_s,
        )
        return robot, lambda target: drive_robot(robot, target, step_s)
    motors = _motors(p)
    material = Material(geom_size=trajectory.module_size, friction=p.friction)
    tree = Tree(trajectory.chain, material, step_s=step_s, motors=motors, damping=p.damping)
    controller = _controller(p, motors)
    return tree, lambda target: controller.drive(tree, target)


def _motors(p: PlaybackParameters) -> Servos | RateMotors | None:
    if p.controller == "computed-torque":
        return None
    if p.torque_limit is not None:
        # The torque of a stiff servo jumps from one limit to the other; a constraint's does not.
        return RateMotors(torque_limit=p.torque_limit)
    return Servos(stiffness=p.stiffness, damping=p.stiffness / p.gain)


def _controller(p: PlaybackParameters, motors: Servos | RateMotors | None) -> Controller:
    if motors is None:
        return ComputedTorque(bandwidth=p.bandwidth, encoder_rad=p.encoder_rad)
    return RateServo(gain=p.gain) if isinstance(motors, RateMotors) else Servo()
