"""Forces on a window on a table: weights, springs of limited torque, a pull, and random draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.table_projection import TableProjection, unwrap_near
from foldback.planner.core import FIXED, peel_step
from foldback.planner.core.structures import GivenDrive, StepsDone, WindowBody
from foldback.planner.explosion.peeling.window import Heading, Window, WindowRun
from foldback.planner.parameters.explosion import TableParameters

MAX_TURNING_ERROR_RAD: Final = 0.5 * np.pi
"""Deviation of a link on the table from its wanted direction, rad, beyond which the torque that
turns it no longer grows."""
MAX_LYING_RISE_PITCH: Final = 0.5
"""Maximum difference in height of the two ends of a link, pitches, for a link that counts as lying
on the table, where it is turned towards its wanted direction."""
PERTURBED_NEIGHBOURS: Final = 5
"""Number of neighbouring modules over which random forces on a stuck chain are averaged."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Forces that move a chain on a table, besides its weight.

    Attributes:
        spring_torque: Maximum torque of a hinge's spring, w·p.
        pull: Force on the last module along the heading, w.
        turning: Torque that turns the rod to its heading, w·p.
        random: (n, 3) random forces on the modules, w; None for none.
        drawn_at: Step at which it was drawn; None for the drive without a perturbation.
    """

    spring_torque: float
    pull: float
    turning: float
    random: Array | None = None
    drawn_at: int | None = None


class TableForces:
    """Forces on a window on a table; for some steps after a draw, they are perturbed.

    Args:
        parameters: Weight and first drive.
        modules: Number of modules of the chain.
        projection: Projection onto the table.
        seed: Seed of the draws.
    """

    max_steps: ClassVar[int] = 1

    def __init__(
        self, parameters: TableParameters, modules: int, projection: TableProjection, *, seed: int
    ) -> None:
        self.heading_errors: Array = np.zeros(1)
        """(m - 2,) heading errors of the window's links against the wanted direction, rad."""
        self._parameters = parameters
        self._modules = modules
        self._projection = projection
        self._random = np.random.default_rng(seed)
        self._drive = self._calm = Drive(
            parameters.largest_spring_torque, parameters.pull, parameters.turning
        )

    def calm(self) -> None:
        """End the perturbation."""
        self._drive = self._calm

    def draw(self, step: int, scale: float) -> None:
        """Draw a perturbation that begins at a step; ``scale`` multiplies its largest forces."""
        random, up = self._random, self._projection.up
        size = scale * random.uniform(0.0, 0.5)
        noise = random.normal(size=(self._modules, 3))
        noise -= 0.5 * np.outer(noise @ up, up)
        alike = np.full(PERTURBED_NEIGHBOURS, 2.0 / PERTURBED_NEIGHBOURS)
        smoothed = [np.convolve(noise[:, axis], alike, "same") for axis in range(3)]
        pull, turning = random.uniform(0.0, 1.0), random.uniform(0.0, 2.0)
        largest = self._parameters.largest_spring_torque * random.uniform(0.75, 1.5 * scale)
        self._drive = Drive(
            spring_torque=min(largest, 8.0),
            pull=pull,
            turning=turning,
            random=size * np.column_stack(smoothed),
            drawn_at=step,
        )

    def make_steps(self, window: Window, body: WindowBody, run: WindowRun) -> StepsDone:
        """Make a step of a window, and go on with the turn of the heading."""
        heading = window.heading
        (aim,) = heading.aims(1, self._parameters.turn_rad)
        window.heading = Heading(aim, heading.target, heading.centre)
        window.place()
        drive = GivenDrive(self.forces(window, run.control.steps + 1), self._end_torque(window))
        run.state.stiffness[:] = self.stiffness(window)
        return peel_step(body, drive, run.state, run.find, run.steps)

    def forces(self, window: Window, step: int) -> Array:
        """Return (m, 3) forces in a step: weights, the pull at the end, and the random ones.

        They end a perturbation whose time is over, and update ``heading_errors``.
        """
        p, drawn_at = self._parameters, self._drive.drawn_at
        if drawn_at is not None and step > drawn_at + p.drawn_steps + 1:
            self.calm()
        drive, up, count = self._drive, self._projection.up, window.modules
        self.heading_errors = self._heading_errors(window)
        forces = np.zeros((count, 3))
        forces[FIXED:] = -up
        if drive.random is not None:
            forces[FIXED:] += drive.random[window.first + FIXED : window.first + count]
        forces[-1] += drive.pull * window.heading.aim - self._rod_mass(window) * up
        forces += self._turning_forces(window)
        return p.weight * forces

    def _turning_forces(self, window: Window) -> Array:
        """Return (m, 3) forces that turn lying links to the wanted direction of the rod.

        A pull at the end would turn links that are far off no more, or the wrong way round.
        """
        positions, up = window.model.positions, self._projection.up
        forces = np.zeros_like(positions)
        links = np.diff(positions[FIXED:], axis=0)
        off = np.clip(self.heading_errors[1:], -MAX_TURNING_ERROR_RAD, MAX_TURNING_ERROR_RAD)
        lies = np.abs(links @ up) < MAX_LYING_RISE_PITCH
        strength = 0.8 * self._drive.pull
        couples = strength * (off * lies)[:, None] * np.cross(links, up)
        forces[FIXED + 1 :] += couples
        forces[FIXED:-1] -= couples
        return forces

    def _heading_errors(self, window: Window) -> Array:
        """Return the (m - 2,) heading errors of all links, rad, counted past full turns."""
        projection, target = self._projection, window.heading.target
        first, last = window.model.rotations[1][:, 0], window.rod_direction
        if abs(first @ projection.up) > MAX_LYING_RISE_PITCH:
            first = target
        turned = projection.turned(window.model.positions[1:], first, last)
        target_angle = projection.angle(target) - projection.angle(first)
        return turned - unwrap_near(target_angle, turned[-1])

    def _rod_mass(self, window: Window) -> float:
        return float(min(window.rod_modules, self._parameters.rod_modules))

    def _end_torque(self, window: Window) -> Array:
        """Return the (3,) torque of the rod's weight, and that which turns it on the table."""
        up, along = self._projection.up, window.rod_direction
        flat = along - (along @ up) * up
        turn = crossed(flat / max(float(np.linalg.norm(flat)), 1e-6), window.heading.aim)
        mass = self._rod_mass(window)
        lever = 0.5 * (1.0 + mass) * along if mass else np.zeros(3)
        return self._parameters.weight * (self._drive.turning * turn - mass * crossed(lever, up))

    def stiffness(self, window: Window) -> Array:
        """Return the (H,) stiffness of springs of limited torque: softer the more they are bent."""
        p = self._parameters
        bends = np.maximum(np.abs(window.state.angles), 1e-3)  # no division by 0
        return p.weight * np.minimum(p.spring_torque, self._drive.spring_torque / bends)


def crossed(a: Array, b: Array) -> Array:
    """Return the (3,) cross product; NumPy's takes many times as long for two vectors."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
