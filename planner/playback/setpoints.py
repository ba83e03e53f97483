"""Setpoints: the targets of a playback, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from foldback.planner.arrays import FRAMES_AT_ONCE, Array
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.chain.module import Module
from foldback.planner.core.structures import ServoTargets
from foldback.planner.playback.reference_curve import Reference
from foldback.planner.playback.time_scaling import TimeScaling, smooth_scaling
from foldback.planner.simulation.mujoco_robot import Substeps

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
        gone_rad: Arc length of the reference up to there, rad, see ``record_lengths``; 0 without.
        setpoints: Setpoints of a robot for the ends of this step and of those after it; None if
            they are among those of an earlier target, or no robot follows.
        rests: True at a rest between two turns.
        substeps: Parts of the step for a robot in MuJoCo; None for others.
    """

    angles: Array
    rates: Array
    accelerations: Array
    fraction: float
    gone_rad: float = 0.0
    setpoints: ServoTargets | None = None
    rests: bool = False
    substeps: Substeps | None = None


class Setpoints(Protocol):
    """Source of the target of each step; None ends the playback."""

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target for a chain with these (J,) angles and rates, once a step."""
        ...


class TimedSetpoints:
    """Targets along a reference by a time scaling, either way; its end is held for a moment.

    Args:
        reference: The curve.
        scaling: Time scaling of S steps along it.
        torques: (S + 1, J) torques of the targets, from ``timed_torques``; None for none.
    """

    def __init__(
        self, reference: Reference, scaling: TimeScaling, torques: Array | None = None
    ) -> None:
        self._targets = _timed_targets(reference, scaling, torques)

    def target(self, angles: Array, rates: Array) -> Target | None:
        """Return the target, see ``Setpoints``."""
        del angles, rates
        return next(self._targets, None)


def timed_torques(reference: Reference, scaling: TimeScaling, module: Module) -> Array:
    """Return (S + 1, J) torques of a floating chain without model errors, one row a step."""
    return np.concatenate(
        [floating_torques(module, *motion) for motion in _timed_motion(reference, scaling)]
    )


def _timed_motion(
    reference: Reference, scaling: TimeScaling
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield angles, rates and accelerations that a chain can follow to the last digit, in chunks.

    Semi-implicit Euler goes from q to q + h (q̇ + h q̈). So q̇ is the last step divided by h, and q̈
    the change of q̇ divided by h: finite differences of the angles, not derivatives.
    """
    step_s, steps = scaling.step_s, len(scaling)
    for start in range(0, steps + 1, FRAMES_AT_ONCE):
        stop = min(start + FRAMES_AT_ONCE, steps + 1)
        # The time scaling rests before its first step and after its last one.
        u = np.clip(scaling.u[np.clip(np.arange(start - 1, stop + 1), 0, steps)], 0.0, 1.0)
        angles = reference.spline(u)
        rates = np.diff(angles, axis=0) / step_s
        yield angles[1:-1], rates[:-1], np.diff(rates, axis=0) / step_s


def _timed_targets(
    reference: Reference, scaling: TimeScaling, torques: Array | None
) -> Iterator[Target]:
    at, rests, step_s = 0, frozenset(scaling.rests), scaling.step_s
    for angles, rates, accelerations in _timed_motion(reference, scaling):
        steps, setpoints = len(angles), None
        if torques is not None:
            ends_rates = rates + step_s * accelerations
            setpoints = ServoTargets(
                angles + step_s * ends_rates, ends_rates, torques[at : at + steps]
            )
        for k in range(steps):
            yield Target(
                angles=angles[k],
                rates=rates[k],
                accelerations=accelerations[k],
                fraction=at / len(scaling),
                gone_rad=float(scaling.u[at]) * reference.length_rad,
                setpoints=setpoints if k == 0 else None,
                rests=at in rests,
            )
            at += 1
    still = replace(
        _still(reference.spline(np.rint(scaling.u[-1])), 1.0),
        gone_rad=float(scaling.u[-1]) * reference.length_rad,
    )
    held = np.tile(still.angles, (SETTLE_STEPS, 1))
    zero = np.zeros_like(held)
    yield replace(still, setpoints=ServoTargets(held, zero, zero))
    for _ in range(1, SETTLE_STEPS):
        yield still


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
