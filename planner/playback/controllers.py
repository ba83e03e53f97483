"""Controllers: from a target to torques on a simulated chain, under one interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planner.playback.setpoints import Target
from planner.simulation.tree import Tree


class Controller(Protocol):
    """Drives the hinges of a tree towards a target in the coming step."""

    def drive(self, tree: Tree, target: Target) -> None:
        """Sets torques or motor targets. ``tree.begin_step`` has been called."""
        ...


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """Position actuators on every hinge: kp (target − angle) − kv rate, limited.

    The feed-forward shifts the target so that the motors also give kv times the wanted rate and the
    torque of the inverse dynamics.

    Attributes:
        stiffness: kp of the tree's actuators.
        damping: kv of the tree's actuators.
        feed_forward: Whether rate and torque are fed forward.
    """

    stiffness: float
    damping: float
    feed_forward: bool

    def drive(self, tree: Tree, target: Target) -> None:
        """See ``Controller``."""
        targets = target.angles
        if self.feed_forward:
            torques = tree.torques_for(target.accelerations)
            targets = targets + (self.damping * target.rates + torques) / self.stiffness
        tree.set_servo_targets(targets)


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
