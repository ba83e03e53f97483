"""Controllers: from a target to torques on a simulated chain, under one interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.playback.setpoints import Target
from planner.simulation.robot import Robot
from planner.simulation.tree import Tree

Array = NDArray[np.float64]


class Plant(Protocol):
    """A chain that is simulated step by step, from ``begin_step`` to ``end_step``."""

    @property
    def angles(self) -> Array:
        """(J,) hinge angles."""
        ...

    @property
    def rates(self) -> Array:
        """(J,) hinge velocities."""
        ...

    @property
    def centres(self) -> Array:
        """(n, 3) the modules' centres, from their mean."""
        ...

    @property
    def root_position(self) -> Array:
        """(3,) the root's centre."""
        ...

    @property
    def root_wxyz(self) -> Array:
        """(4,) the root's orientation."""
        ...

    @property
    def motor_torques(self) -> Array:
        """(J,) what the motors did in the last step."""
        ...

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Sets a configuration at rest."""
        ...

    def begin_step(self) -> None:
        """Everything of a step that depends on positions and velocities."""
        ...

    def end_step(self) -> None:
        """The rest of a step; ``SimulationError`` where the numbers are bad."""
        ...

    def stop_drifting(self) -> None:
        """Takes away the momentum that integration has added."""
        ...


class Controller(Protocol):
    """Drives the hinges of a tree towards a target in the coming step."""

    def drive(self, tree: Tree, target: Target) -> None:
        """Sets torques or motor targets. ``tree.begin_step`` has been called."""
        ...


def drive_robot(robot: Robot, target: Target, step_s: float) -> None:
    """Sends a robot's servos on, in the coming step, from a target to the next one."""
    assert target.torques is not None
    rates = target.rates + step_s * target.accelerations
    robot.follow(target.angles + step_s * rates, rates, target.torques)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComputedTorque:
    """Inverse dynamics of the floating chain for q̈ = q̈_ref + 2w ė + w² e.

    Attributes:
        bandwidth: w in 1/s.
        encoder_rad: Step of the hinges' encoders, by which e is known; 0 for exact ones.
    """

    bandwidth: float
    encoder_rad: float

    def drive(self, tree: Tree, target: Target) -> None:
        """See ``Controller``."""
        w, step = self.bandwidth, self.encoder_rad
        angles = np.rint(tree.angles / step) * step if step else tree.angles
        wanted = (
            target.accelerations
            + 2.0 * w * (target.rates - tree.rates)
            + w * w * (target.angles - angles)
        )
        tree.apply_torques(tree.torques_for(wanted))


class Servo:
    """The paper's servo where motors have no limit: position actuators that pull to the target."""

    def drive(self, tree: Tree, target: Target) -> None:
        """See ``Controller``."""
        tree.set_servo_targets(target.angles)


@dataclass(frozen=True, slots=True, kw_only=True)
class RateServo:
    """The paper's servo: rate motors that turn at a rate proportional to what is left.

    Attributes:
        gain: Rate for one radian that is left, in 1/s.
    """

    gain: float

    def drive(self, tree: Tree, target: Target) -> None:
        """See ``Controller``."""
        tree.set_rates(target.rates + self.gain * (target.angles - tree.angles))
