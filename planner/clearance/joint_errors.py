"""Joint errors: how large modules and hinge errors may be for most robots to fold without contact.

Robots are sampled: each has an error of its own in each hinge, the same all the time, independent
and uniform between plus and minus the stated error. With a stated error, the whole motion of each
robot is swept, so that a collision between two frames counts too. Without one, only the folded
shape is looked at, which limits most motions and takes a hundredth of the time, and for short
chains the closest frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from math import comb, radians
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.margins import FAILURE_PROBABILITY, FULL_SIZE, MAX_MARGIN_MODULES
from foldback.planner.clearance.sweep import frame_clearances, sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.joint_error import MIN_SIZE
from foldback.planner.progress import Cancelled, never

ROBOTS: Final = 300
"""Number of robots that are sampled."""
MAX_TOUCHING_WITH_ERROR: Final = 8
"""Maximum number of sampled robots whose modules may touch with the largest error that a plan
tolerates. With 8 of 300, at most 5 of 100 robots touch, with a confidence of 96 %."""
MAX_TOUCHING_AT_SIZE: Final = 1
"""Maximum number of sampled robots whose modules may touch at the largest module size. Robots are
built with this size: with 1 of 300, hardly any hundred of them has more than five that touch."""
MAX_ANGLES: Final = 2**22
"""Maximum number of angles of a motion (frames × hinges) for which robots are sampled; a sweep of
so many takes about a second of the processor."""
USUAL_ERROR_RAD: Final = radians(0.3)
"""Joint error of good servos, rad, for which a module size is estimated without a stated error."""
SHORT_CHAIN_MODULES: Final = 64
"""Number of modules of a chain up to which an estimate looks at frames of the motion, too. In snake
cubes, of 24 to 27 modules, the motion limits the error; in chains of more modules, the folded
shape did (decision 0076)."""
CLOSEST_FRAMES: Final = 5
"""Number of these frames, those with the least clearance."""
SIZES: Final = np.linspace(MIN_SIZE, FULL_SIZE, 751).round(3)
"""Module sizes that are tried, in pitches."""
ERRORS_RAD: Final = np.radians(5.0) * 1.01 ** np.arange(-900.0, 1.0)
"""Errors that are tried, rad, each 1 % larger than the one before, up to 5°: no servo is worse, and
larger errors change the shape more than they make modules touch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointErrors:
    """Errors and module sizes with which hardly any sampled robot touches itself.

    Attributes:
        error_rad: Error of each hinge for which a module size was looked for.
        module_size: Largest module size, as a fraction of the pitch, with errors up to
            ``error_rad``; None if ``MIN_SIZE`` is too large.
        tolerated_rad: Largest error of each hinge at the module size of the plan; 0 if even the
            smallest that was tried is too large.
        robots: Number of sampled robots.
        touching_at_size, touching_with_error: Maximum number of these that touch with
            ``module_size``, and with ``tolerated_rad``.
        swept: True if the whole motion of each robot was swept; False for an estimate from the
            folded shape.
    """

    error_rad: float
    module_size: float | None
    tolerated_rad: float
    robots: int = ROBOTS
    touching_at_size: int = MAX_TOUCHING_AT_SIZE
    touching_with_error: int = MAX_TOUCHING_WITH_ERROR
    swept: bool = True


def joint_errors(
    chain: Chain,
    motion: Motion,
    *,
    module_size: float,
    clearances: Array,
    error_rad: float | None = None,
    cancelled: Cancelled = never,
) -> JointErrors | None:
    """Return how large modules and errors may be; None for a very long chain, or if cancelled.

    Args:
        chain: The chain.
        motion: A motion that is proved clear.
        module_size: Module size of the plan, as a fraction of the pitch.
        clearances: (F,) clearance of each frame, pitches.
        error_rad: Error of each hinge for which a module size is looked for; None for that of
            good servos and an estimate. For a very long motion, there is only an estimate, too.
        cancelled: Polled between robots.
    """
    swept = error_rad is not None and len(motion) * len(chain.folded_rad) <= MAX_ANGLES
    if not swept and len(chain) > MAX_MARGIN_MODULES:
        return None
    if swept:
        angles = motion.angles(chain)
    else:
        frames = [0, -1]
        if len(chain) <= SHORT_CHAIN_MODULES:
            frames += np.argsort(clearances, kind="stable")[:CLOSEST_FRAMES].tolist()
        angles = np.stack([motion.angles_at(chain, frame) for frame in frames])
    robots = SampledRobots(chain, angles, swept=swept, cancelled=cancelled)
    size = robots.largest_size(error_rad := error_rad or USUAL_ERROR_RAD)
    error = robots.largest_error(module_size)
    if cancelled():
        return None
    return JointErrors(
        error_rad=error_rad, module_size=size, tolerated_rad=error or 0.0, swept=swept
    )


def confidence(robots: int, touching: int) -> float:
    """Return the confidence, 0 to 1, that few enough of all robots touch.

    If a larger share than ``FAILURE_PROBABILITY`` of all robots touched, no more than ``touching``
    of those sampled would do so with a probability of at most one minus this.
    """
    p = FAILURE_PROBABILITY
    fewer = sum(comb(robots, k) * p**k * (1.0 - p) ** (robots - k) for k in range(touching + 1))
    return 1.0 - fewer


@dataclass(slots=True, eq=False)
class SampledRobots:
    """Robots with random errors that follow a motion.

    Args:
        chain: The chain.
        angles: (F, J) hinge angles of the motion, or of the frames to look at, rad.
        seed: Seed of the errors.
        count: Number of robots.
        swept: Sweep whole motions; otherwise look only at the frames.
        cancelled: Polled between robots; then results mean nothing.
    """

    chain: Chain
    angles: Array
    seed: int = 0
    count: int = ROBOTS
    swept: bool = True
    cancelled: Cancelled = never
    errors: Array = field(init=False)
    _shapes: Array = field(init=False)

    def __post_init__(self) -> None:
        """Draw the (N, J) errors of the robots, as fractions of the stated error."""
        shapes = self.angles[[0, -1]] if self.swept else self.angles
        bent = np.any(shapes, axis=1)  # the straight chain is clear
        bent[-1] = True
        self._shapes = shapes[bent]
        random = np.random.default_rng(self.seed)
        self.errors = random.uniform(-1.0, 1.0, (self.count, self.angles.shape[1]))

    def largest_size(self, error_rad: float, touching: int = MAX_TOUCHING_AT_SIZE) -> float | None:
        """Return the largest module size at which few enough touch; None if there is none."""
        index, lower = self._largest([(error_rad, size) for size in SIZES.tolist()], touching)
        index = lower(index)
        return None if index < 0 else float(SIZES[index])

    def largest_error(
        self, module_size: float, touching: int = MAX_TOUCHING_WITH_ERROR
    ) -> float | None:
        """Return the largest error, rad, at which few enough touch; None if there is none."""
        settings = [(error_rad, module_size) for error_rad in ERRORS_RAD.tolist()]
        index, lower = self._largest(settings, touching)
        # Unlike a smaller module, a smaller error may touch where a larger one is clear: after a
        # change, all robots are swept again.
        while (lowered := lower(index)) < index:
            index = lowered
        return None if index < 0 else float(ERRORS_RAD[index])

    def touching(self, error_rad: float, module_size: float) -> list[int]:
        """Return the robots whose modules touch at any moment of the motion."""
        return [
            robot
            for robot in range(self.count)
            if not self._is_clear(robot, error_rad, module_size)
        ]

    def _is_clear(self, robot: int, error_rad: float, size: float) -> bool:
        disturbed = self.angles + error_rad * self.errors[robot]
        return sweep(self.chain, disturbed, module_size=size, share=0.0).bound > 0.0

    def _shape_clearances(self, robots: Ints, error_rad: float, size: float) -> Array:
        """Return the least clearance of each robot's folded shapes."""
        errors = error_rad * self.errors[robots]
        angles = (self._shapes + errors[:, None]).reshape(-1, errors.shape[1])
        clearances = frame_clearances(self.chain, angles, module_size=size)
        return clearances.reshape(len(robots), -1).min(axis=1)

    def _largest(
        self, settings: list[tuple[float, float]], touching: int
    ) -> tuple[int, Callable[[int], int]]:
        """Return the index of the last setting that few enough robots tolerate, and what lowers it.

        It is that of the folded shapes, which limit most motions and are checked in a hundredth of
        the time. The whole motions may tolerate less.

        Args:
            settings: Error and module size, in ascending order.
            touching: Maximum number of robots that may touch.
        """
        low, high, robots, left = -1, len(settings), np.arange(self.count), touching
        while high - low > 1 and not self.cancelled():
            middle = (low + high) // 2
            touches = self._shape_clearances(robots, *settings[middle]) <= 0.0
            if (count := int(touches.sum())) > left:  # the others tolerate this and more
                high, robots = middle, robots[touches]
            else:
                low, robots, left = middle, robots[~touches], left - count
        if low < 0 or not self.swept:
            return low, lambda index: index

        def is_clear(robot: int, index: int) -> bool:
            return self.cancelled() or self._is_clear(robot, *settings[index])

        order = np.argsort(self._shape_clearances(np.arange(self.count), *settings[low])).tolist()
        return low, partial(_lowered, robots=order, is_clear=is_clear, touching=touching)


def _lowered(
    index: int, robots: Iterable[int], is_clear: Callable[[int, int], bool], touching: int
) -> int:
    """Return an index, lowered until few enough robots touch; −1 if too many always do.

    Args:
        index: Index of a value.
        robots: Robots, those that touch first before the others.
        is_clear: Returns True if a robot is clear at an index.
        touching: Maximum number of robots that may touch.
    """
    limits: list[int] = []
    for robot in robots:
        if index < 0 or is_clear(robot, index):
            continue
        low, high = -1, index
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if is_clear(robot, middle) else (low, middle)
        limits = sorted([*limits, low])
        if len(limits) > touching:
            index = limits.pop()
            limits = [limit for limit in limits if limit < index]
    return index
