"""Setpoints: the targets of a playback, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from foldback.planner.arrays import FRAMES_AT_ONCE, Array, Flags
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.chain.module import Module
from foldback.planner.core.structures import ServoTargets
from foldback.planner.playback.reference_curve import Reference
from foldback.planner.playback.time_scaling import TimeScaling, smooth_scaling

SETTLE_STEPS: Final = 15
"""Number of simulation steps for which the goal angles remain the target after the motion along the
planned curve, so that joint errors decay before the final frame. Measured from 10 to 21: the same
clearance (decision 0051)."""
STALL_STEPS: Final = 3000
"""A playback by the published rule (preset ``paper``) waits until all hinges are near a recorded
configuration before it goes on to the next. This is the maximum number of simulation steps, beyond
the minimum, that it waits; then it ends as jammed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """Target of the hinges in one step.

    Attributes:
        angles, rates, accelerations: (J,) angles, rad, and their derivatives, rad/s and rad/s².
        fraction: Progress of the playback, 0 to 1.
        rests: True at a rest between two turns.
    """

    angles: Array
    rates: Array
    accelerations: Array
    fraction: float
    rests: bool = False


class Setpoints(Protocol):
    """Source of the target of each step; None ends the playback."""

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target for a chain with these (J,) angles and rates, once a step."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedTargets:
    """Targets of S steps along a reference.

    Attributes:
        angles, rates, accelerations: (S, J) angles at the beginning of each step, rad, and their
            derivatives, rad/s and rad/s².
        torques: (S, J) torques that a robot without model errors needs; zero if no robot follows.
        gone_rad: (S,) arc length of the reference up to there, rad, see ``record_lengths``.
        fractions: (S,) progress along the reference, 0 to 1.
        rests: (S,) True at rests between two turns.
        step_s: Time step, s.
    """

    angles: Array
    rates: Array
    accelerations: Array
    torques: Array
    gone_rad: Array
    fractions: Array
    rests: Flags
    step_s: float

    def __len__(self) -> int:
        """Return the number of steps S."""
        return len(self.angles)

    @property
    def servo_targets(self) -> ServoTargets:
        """Setpoints of servos for the ends of the steps."""
        rates = self.rates + self.step_s * self.accelerations
        return ServoTargets(self.angles + self.step_s * rates, rates, self.torques)


def timed_targets(
    reference: Reference,
    scaling: TimeScaling,
    torques: Array | None = None,
    *,
    at_once: int = FRAMES_AT_ONCE,
) -> Iterator[TimedTargets]:
    """Yield the targets along a reference by a time scaling; its end is held for a moment.

    Args:
        reference: The curve.
        scaling: Time scaling of S steps along it, either way.
        torques: (S + 1, J) torques of the targets, from ``timed_torques``; None for none.
        at_once: Maximum number of steps that are yielded together.
    """
    steps, step_s = len(scaling), scaling.step_s
    is_rest = np.zeros(steps + 1, dtype=bool)
    is_rest[list(scaling.rests)] = True
    start = 0
    for angles, rates, accelerations in _timed_motion(reference, scaling, at_once):
        part = slice(start, start + len(angles))
        yield TimedTargets(
            angles=angles,
            rates=rates,
            accelerations=accelerations,
            torques=np.zeros_like(angles) if torques is None else torques[part],
            gone_rad=scaling.u[part] * reference.length_rad,
            fractions=np.arange(steps + 1)[part] / steps,
            rests=is_rest[part],
            step_s=step_s,
        )
        start = part.stop
    end = reference.spline(np.rint(scaling.u[-1]))
    held = np.tile(end, (SETTLE_STEPS, 1))
    zero = np.zeros_like(held)
    yield TimedTargets(
        angles=held,
        rates=zero,
        accelerations=zero,
        torques=zero,
        gone_rad=np.full(SETTLE_STEPS, scaling.u[-1] * reference.length_rad),
        fractions=np.ones(SETTLE_STEPS),
        rests=np.zeros(SETTLE_STEPS, dtype=bool),
        step_s=step_s,
    )


class TimedSetpoints:
    """Targets along a reference by a time scaling, one by one.

    Args:
        reference: The curve.
        scaling: Time scaling of S steps along it.
    """

    def __init__(self, reference: Reference, scaling: TimeScaling) -> None:
        self._targets = self._one_by_one(timed_targets(reference, scaling))

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target, see ``Setpoints``."""
        del angles, rates
        return next(self._targets, None)

    def _one_by_one(self, parts: Iterator[TimedTargets]) -> Iterator[Target]:
        for targets in parts:
            for k in range(len(targets)):
                yield Target(
                    angles=targets.angles[k],
                    rates=targets.rates[k],
                    accelerations=targets.accelerations[k],
                    fraction=float(targets.fractions[k]),
                    rests=bool(targets.rests[k]),
                )


def timed_torques(reference: Reference, scaling: TimeScaling, module: Module) -> Array:
    """Return (S + 1, J) torques of a floating chain without model errors, one row a step."""
    return np.concatenate(
        [floating_torques(module, *motion) for motion in _timed_motion(reference, scaling)]
    )


def _timed_motion(
    reference: Reference, scaling: TimeScaling, at_once: int = FRAMES_AT_ONCE
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield angles, rates and accelerations that a chain can follow to the last digit, in chunks.

    Semi-implicit Euler goes from q to q + h (q̇ + h q̈). So q̇ is the last step divided by h, and q̈
    the change of q̇ divided by h: finite differences of the angles, not derivatives.
    """
    step_s, steps = scaling.step_s, len(scaling)
    for start in range(0, steps + 1, at_once):
        stop = min(start + at_once, steps + 1)
        # The time scaling rests before its first step and after its last one.
        u = np.clip(scaling.u[np.clip(np.arange(start - 1, stop + 1), 0, steps)], 0.0, 1.0)
        angles = reference.spline(u)
        rates = np.diff(angles, axis=0) / step_s
        yield angles[1:-1], rates[:-1], np.diff(rates, axis=0) / step_s


class Backwards:
    """Reversed motion, with a snapshot for each step of its time.

    Args:
        time_s: (F,) times, from 0 on, s.
        angles_rad: (F, J) angles at these, joined by straight lines, rad.
        step_s: Time step, s.
    """

    def __init__(self, time_s: Array, angles_rad: Array, step_s: float) -> None:
        self._time_s, self._angles, self._step_s = time_s, angles_rad, step_s

    def __len__(self) -> int:
        """Return the number of snapshots; the last one is the beginning itself."""
        return int(np.ceil(self._time_s[-1] / self._step_s)) + 1

    def __getitem__(self, index: int, /) -> Array:
        """Return the (J,) angles ``index`` steps before the end."""
        time_s = max(0.0, float(self._time_s[-1]) - index * self._step_s)
        k = int(np.searchsorted(self._time_s, time_s, "right")) - 1
        if k + 1 == len(self._angles):
            return self._angles[k].copy()
        part = (time_s - self._time_s[k]) / (self._time_s[k + 1] - self._time_s[k])
        return (1.0 - part) * self._angles[k] + part * self._angles[k + 1]


Snapshots = Array | Backwards
"""Hinge angles, (J,) each, in the order in which they are the target."""


class SnapshotSetpoints:
    """Targets by the paper's rule: each snapshot is the target until the chain is near it.

    Args:
        snapshots: Snapshots to follow.
        threshold_rad2: Largest squared error, rad², below which the next snapshot is the target.
        steps_per_snapshot: Minimum number of steps for each snapshot. With 0 the threshold alone
            decides, and snapshots that the chain is near to already are skipped.
    """

    def __init__(
        self, snapshots: Snapshots, *, threshold_rad2: float, steps_per_snapshot: int
    ) -> None:
        self._snapshots = snapshots
        self._threshold = threshold_rad2
        self._steps_per_snapshot = steps_per_snapshot
        self._next = 0
        self._steps = 0
        self._ending = _Ending()

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target, see ``Setpoints``."""
        last = len(self._snapshots) - 1
        while self._next < last and self._steps >= self._least() and self._near(angles):
            self._next += 1
            self._steps = 0
        if self._next == last and self._ending.over(rates):
            return None
        if self._steps >= self._steps_per_snapshot + STALL_STEPS:
            return None  # what is tangled stays so
        self._steps += 1
        return _still(self._snapshots[self._next], self._next / max(1, last))

    def _least(self) -> int:
        """Return the minimum steps of this snapshot; the first one is never skipped."""
        return max(self._steps_per_snapshot, int(self._next == 0))

    def _near(self, angles: Array) -> bool:
        return float(((self._snapshots[self._next] - angles) ** 2).max()) < self._threshold


class DirectSetpoints:
    """Targets from straight to folded in a line, all hinges at once, until rest: the baseline."""

    def __init__(self, folded: Array, steps: int, step_s: float) -> None:
        self._folded = folded
        self._scaling = smooth_scaling(steps=steps, step_s=step_s)
        self._step = 0
        self._ending = _Ending()

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target, see ``Setpoints``."""
        k = self._step
        if k >= len(self._scaling):
            return None if self._ending.over(rates) else _still(self._folded, 1.0)
        self._step += 1
        angles = self._scaling.u[k] * self._folded
        return Target(
            angles=angles,
            rates=self._scaling.rate[k] * self._folded,
            accelerations=self._scaling.acceleration[k] * self._folded,
            fraction=k / len(self._scaling),
        )


class _Ending:
    """Detector of a chain at rest."""

    def __init__(self) -> None:
        self._still = 0

    def over(self, rates: Array) -> bool:
        self._still = self._still + 1 if np.abs(rates).max() < 1e-4 else 0
        return self._still >= 500


def _still(angles: Array, fraction: float) -> Target:
    zero = np.zeros_like(angles)
    return Target(angles=angles, rates=zero, accelerations=zero, fraction=fraction)
