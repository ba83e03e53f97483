"""Guides: what a playback aims at, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from planner.chain.dynamics import floating_torques
from planner.chain.module import Module
from planner.playback.reference import Reference
from planner.playback.time_law import TimeLaw, smooth_law

Array = NDArray[np.float64]
CHUNK: Final = 256
SETTLE_STEPS: Final = 15
"""Steps that the last target is held for at the end."""
AT_REST_RATE: Final = 1e-4
"""Hinge speed in rad/s below which the chain is at rest."""
STILL_STEPS: Final = 500
"""Steps at rest after which the playback ends."""
STUCK_STEPS: Final = 3000
"""Steps beyond its own that a snapshot stays the target before the playback counts as stuck."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """Where the hinges should be in this step, how fast, and how that changes.

    Attributes:
        angles, rates, accelerations: (J,).
        fraction: How far the playback is, 0 to 1.
        gone_rad: Length of the reference up to there, see ``record_lengths``; 0 without one.
        torques: (J,) that a robot without faults needs for it; None where nobody asks for them.
    """

    angles: Array
    rates: Array
    accelerations: Array
    fraction: float
    gone_rad: float = 0.0
    torques: Array | None = None


class Setpoints(Protocol):
    """Gives the target of each step; None ends the playback."""

    def target(self, angles: Array, rates: Array) -> Target | None:
        """The target for a chain with these (J,) angles and rates, called once a step."""
        ...


class TimedSetpoints:
    """Runs along a reference by a time law, either way, then holds its end for a moment.

    Args:
        reference: The curve.
        law: S steps along it.
        torques: (S + 1, J) to pass on, from ``timed_torques``; None for none.
    """

    def __init__(self, reference: Reference, law: TimeLaw, torques: Array | None = None) -> None:
        self._targets = _timed_targets(reference, law, torques)

    def target(self, angles: Array, rates: Array) -> Target | None:
        """See ``Setpoints``."""
        del angles, rates
        return next(self._targets, None)


def timed_torques(reference: Reference, law: TimeLaw, module: Module) -> Array:
    """(S + 1, J) torques at the steps of a law, of a chain that floats freely, without faults."""
    return np.concatenate(
        [floating_torques(module, *motion) for motion in _timed_motion(reference, law)]
    )


def _timed_motion(reference: Reference, law: TimeLaw) -> Iterator[tuple[Array, Array, Array]]:
    """Angles, rates and accelerations that a chain can follow to the last digit, some at a time.

    Semi-implicit Euler goes from q to q + h (q̇ + h q̈). So q̇ is the way of the last step, and q̈
    what makes the next one another: finite differences of the angles, not derivatives.
    """
    step_s, steps = law.step_s, len(law)
    for start in range(0, steps + 1, CHUNK):
        stop = min(start + CHUNK, steps + 1)
        # The law rests before its first step and after its last one.
        u = np.clip(law.u[np.clip(np.arange(start - 1, stop + 1), 0, steps)], 0.0, 1.0)
        angles = reference.spline(u)
        rates = np.diff(angles, axis=0) / step_s
        yield angles[1:-1], rates[:-1], np.diff(rates, axis=0) / step_s


def _timed_targets(reference: Reference, law: TimeLaw, torques: Array | None) -> Iterator[Target]:
    at = 0
    for angles, rates, accelerations in _timed_motion(reference, law):
        for k in range(len(angles)):
            yield Target(
                angles=angles[k],
                rates=rates[k],
                accelerations=accelerations[k],
                fraction=at / len(law),
                gone_rad=float(law.u[at]) * reference.length_rad,
                torques=None if torques is None else torques[at],
            )
            at += 1
    end = reference.spline(np.rint(law.u[-1]))
    gone_rad = float(law.u[-1]) * reference.length_rad
    for _ in range(SETTLE_STEPS):
        yield replace(_still(end, 1.0), gone_rad=gone_rad)


class Snapshots(Protocol):
    """Hinge angles, (J,) each, in the order in which they are the target."""

    def __len__(self) -> int:
        """How many."""
        ...

    def __getitem__(self, index: int, /) -> Array:
        """One of them."""
        ...


class Backwards:
    """A motion from its end to its beginning, with a snapshot for each step of its time.

    Args:
        time_s: (F,) times, from 0 on.
        angles_rad: (F, J) angles at these, joined by straight lines.
        step_s: Time of a step.
    """

    def __init__(self, time_s: Array, angles_rad: Array, step_s: float) -> None:
        self._time_s, self._angles, self._step_s = time_s, angles_rad, step_s

    def __len__(self) -> int:
        """Snapshots; the last one is the beginning itself."""
        return int(np.ceil(self._time_s[-1] / self._step_s)) + 1

    def __getitem__(self, index: int, /) -> Array:
        """The (J,) angles ``index`` steps before the end."""
        time_s = max(0.0, float(self._time_s[-1]) - index * self._step_s)
        k = int(np.searchsorted(self._time_s, time_s, "right")) - 1
        if k + 1 == len(self._angles):
            return self._angles[k].copy()
        part = (time_s - self._time_s[k]) / (self._time_s[k + 1] - self._time_s[k])
        return (1.0 - part) * self._angles[k] + part * self._angles[k + 1]


class SnapshotSetpoints:
    """The paper's rule: each snapshot is the target until the chain is near enough to it.

    Args:
        snapshots: What to follow.
        threshold_rad2: A snapshot is left when the largest squared error against it is below this.
        least_steps: … and after so many steps at least. With 0 the threshold alone decides, and
            snapshots that the chain is near to already are passed over.
    """

    def __init__(self, snapshots: Snapshots, *, threshold_rad2: float, least_steps: int) -> None:
        self._snapshots = snapshots
        self._threshold = threshold_rad2
        self._least_steps = least_steps
        self._next = 0
        self._steps = 0
        self._ending = _Ending()

    def target(self, angles: Array, rates: Array) -> Target | None:
        """See ``Setpoints``."""
        last = len(self._snapshots) - 1
        while self._next < last and self._steps >= self._least() and self._near(angles):
            self._next += 1
            self._steps = 0
        if self._next == last and self._ending.over(rates):
            return None
        if self._steps >= self._least_steps + STUCK_STEPS:
            return None  # what is tangled stays so
        self._steps += 1
        return _still(self._snapshots[self._next], self._next / max(1, last))

    def _least(self) -> int:
        """Steps for this snapshot; the first one begins the motion, and is never passed over."""
        return max(self._least_steps, int(self._next == 0))

    def _near(self, angles: Array) -> bool:
        return float(((self._snapshots[self._next] - angles) ** 2).max()) < self._threshold


class DirectSetpoints:
    """From straight to folded in a line, all hinges at once, then waits for rest: the baseline."""

    def __init__(self, folded: Array, steps: int, step_s: float) -> None:
        self._folded = folded
        self._law = smooth_law(steps=steps, step_s=step_s)
        self._step = 0
        self._ending = _Ending()

    def target(self, angles: Array, rates: Array) -> Target | None:
        """See ``Setpoints``."""
        k = self._step
        if k >= len(self._law):
            return None if self._ending.over(rates) else _still(self._folded, 1.0)
        self._step += 1
        angles = self._law.u[k] * self._folded
        return Target(
            angles=angles,
            rates=self._law.rate[k] * self._folded,
            accelerations=self._law.acceleration[k] * self._folded,
            fraction=k / len(self._law),
        )


class _Ending:
    """Notices that a chain has come to rest for good."""

    def __init__(self) -> None:
        self._still = 0

    def over(self, rates: Array) -> bool:
        self._still = self._still + 1 if np.abs(rates).max() < AT_REST_RATE else 0
        return self._still >= STILL_STEPS


def _still(angles: Array, fraction: float) -> Target:
    zero = np.zeros_like(angles)
    return Target(angles=angles, rates=zero, accelerations=zero, fraction=fraction, torques=zero)
