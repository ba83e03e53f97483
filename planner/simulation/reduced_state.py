"""Reduced state of a chain: its hinge angles and the pose of one root, and their derivatives.

Only this state is integrated. Poses of the modules follow from it, so links never come apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.core.structures import ReducedState


@dataclass(slots=True, kw_only=True, eq=False)
class State:
    """Reduced state of a chain: what is integrated.

    Attributes:
        angles: (J,) hinge angles, rad.
        rates: (J,) hinge velocities, rad/s.
        position: (3,) centre of the root, pitches.
        rotation: (3, 3) orientation of the root.
        velocity: (3,) velocity of the root in the world frame, pitches/s.
        spin: (3,) angular velocity ω of the root in its own frame, rad/s.
    """

    angles: Array
    rates: Array
    position: Array
    rotation: Array
    velocity: Array
    spin: Array

    @classmethod
    def at_rest(cls, angles: Array, position: Array, rotation: Array) -> State:
        """Return a state that does not move."""
        return cls(
            angles=angles.copy(),
            rates=np.zeros_like(angles),
            position=position.copy(),
            rotation=rotation.copy(),
            velocity=np.zeros(3),
            spin=np.zeros(3),
        )

    @property
    def reduced(self) -> ReducedState:
        """Arrays of the state, as kernels take them."""
        return ReducedState(
            self.angles, self.rates, self.position, self.rotation, self.velocity, self.spin
        )

    def copy(self) -> State:
        """Return a state that shares no array with this one."""
        return State(
            angles=self.angles.copy(),
            rates=self.rates.copy(),
            position=self.position.copy(),
            rotation=self.rotation.copy(),
            velocity=self.velocity.copy(),
            spin=self.spin.copy(),
        )

    def scale_velocities(self, factor: float) -> None:
        """Multiply all velocities by a factor."""
        self.rates *= factor
        self.velocity *= factor
        self.spin *= factor

    def accelerate(self, acceleration: Acceleration, step_s: float, drag: float) -> None:
        """Integrate velocities: q̇ ← (q̇ + h q̈) / (1 + αh).

        The drag α slows all velocities by one factor, so it respects every linear constraint.
        """
        self.rates += step_s * acceleration.hinges
        self.velocity += step_s * acceleration.linear
        self.spin += step_s * acceleration.angular
        self.scale_velocities(1.0 / (1.0 + drag * step_s))

    def advance(self, step_s: float) -> None:
        """Integrate the configuration: q ← q + h q̇."""
        self.angles += step_s * self.rates
        self.position += step_s * self.velocity
        if self.spin.any():
            self.rotation = self.rotation @ turned(self.spin * step_s)

    def stop_at(self, stops: Array) -> None:
        """Set hinges beyond their range back to its end, at rest: a joint's stop gives nothing.

        Args:
            stops: (J, 2) smallest and largest angle of each hinge, rad.
        """
        beyond = (self.angles < stops[:, 0]) | (self.angles > stops[:, 1])
        if beyond.any():
            self.angles[:] = np.clip(self.angles, stops[:, 0], stops[:, 1])
            self.rates[beyond] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Acceleration:
    """Second time derivative of the reduced state, and figures of the contacts.

    Attributes:
        hinges: (J,) hinge accelerations, rad/s².
        linear: (3,) acceleration of the root in the world frame, pitches/s².
        angular: (3,) angular acceleration α of the root in its own frame, rad/s².
        contacts: Number of contacts.
        depth: Depth of the deepest contact, pitches; 0 if there is none.
    """

    hinges: Array
    linear: Array
    angular: Array
    contacts: int
    depth: float


def turned(rotation_vector: Array) -> Array:
    """Return the (3, 3) rotation by a (3,) rotation vector, rad."""
    angle = float(np.linalg.norm(rotation_vector))
    half = 0.5 * angle
    scale = 0.5 if angle < 1e-12 else np.sin(half) / angle
    return matrix_from_wxyz(np.concatenate([[np.cos(half)], scale * rotation_vector]))
