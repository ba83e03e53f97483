"""Smoothness: what can be said of how a motion goes, apart from whether it is clear."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.dynamics import floating_torques
from planner.reference import Reference, record_lengths
from planner.timelaw import duration, torque_bounded_profile

Array = NDArray[np.float64]
DISTANCE_WEIGHT: Final = 0.03
"""Radians that a displacement of one pitch counts as, as in a playback's reference."""
SPACING_RAD: Final = 0.03
"""Of the reference's control points, as in a playback."""
SAMPLES_A_RAD: Final = 45
FEWEST_SAMPLES: Final = 100
MOVING_FRACTION: Final = 0.1
"""A hinge counts as moving when it is at least this fast, as a fraction of the fastest one."""
CHUNK: Final = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoothness:
    """How a motion goes.

    Attributes:
        frames: How many.
        length_rad: Its length, see ``planner.reference.record_lengths``: so long takes a playback.
        travel_rad: How far all hinges turn together.
        largest_way: The way of the module that goes farthest, in pitches; the centre of mass and
            the root's orientation are held still.
        mean_way: Of all modules on average.
        hinges_moving_mean: Hinges that move at the same time.
        fold_time_s: Time it takes when no hinge may be faster than 1 rad/s, see ``Pace``.
        peak_torque: Largest hinge torque of a fold that takes one second, in units of module mass ·
            pitch² / s². A fold of T seconds takes 1/T² of it.
    """

    frames: int
    length_rad: float
    travel_rad: float
    largest_way: float
    mean_way: float
    hinges_moving_mean: float
    fold_time_s: float
    peak_torque: float

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pace:
    """How fast a playback would run through a motion: with bounded torque, at rest at both ends.

    Attributes:
        passed: (F,) when it passes each frame, from 0 to 1.
        top_speed: Largest hinge speed when all takes one second, in rad/s.
        peak_torque: As in ``Smoothness``.
    """

    passed: Array
    top_speed: float
    peak_torque: float

    @classmethod
    def of(cls, chain: Chain, angles: Array) -> Pace:
        """The pace of (F, J) configurations: that of the playback's law along its reference."""
        lengths = record_lengths(chain, angles, DISTANCE_WEIGHT)
        if lengths[-1] <= 0.0:
            return cls(passed=np.linspace(0.0, 1.0, len(angles)), top_speed=0.0, peak_torque=0.0)
        reference = Reference.through(
            chain, angles, spacing_rad=SPACING_RAD, distance_weight=DISTANCE_WEIGHT
        )
        u = np.linspace(0.0, 1.0, max(FEWEST_SAMPLES, int(SAMPLES_A_RAD * lengths[-1])))
        where, first, second = reference.spline(u), reference.first(u), reference.second(u)
        a = floating_torques(chain.module, where, np.zeros_like(first), first)
        b = floating_torques(chain.module, where, first, second)
        z = torque_bounded_profile(u, a, b)
        total = duration(u, z)
        change = 0.5 * np.gradient(z, u)
        torques = a * change[:, None] + b * z[:, None]
        rates = np.sqrt(z)
        times = np.cumsum(2.0 * np.diff(u) / np.maximum(rates[1:] + rates[:-1], 1e-12))
        times = np.concatenate([[0.0], times / times[-1]])
        return cls(
            passed=np.interp(lengths / lengths[-1], u, times),
            top_speed=float((np.abs(first).max(axis=1) * rates).max()) * total,
            peak_torque=float(np.abs(torques).max()) * total**2,
        )

    def times(self, max_speed_rad_s: float, max_torque: float) -> Array:
        """(F,) the soonest times at that pace with bounded hinge speeds and torques."""
        slowest = max(self.top_speed / max_speed_rad_s, np.sqrt(self.peak_torque / max_torque))
        return slowest * self.passed


def smoothness(chain: Chain, angles: Array, pace: Pace | None = None) -> Smoothness:
    """What can be said of (F, J) configurations; their pace is worked out when it is not given."""
    pace = Pace.of(chain, angles) if pace is None else pace
    turned = np.abs(np.diff(angles, axis=0))
    fastest = turned.max(axis=1, initial=0.0)
    moving = (turned > MOVING_FRACTION * fastest[:, None]).sum(axis=1)[fastest > 0.0]
    ways = _ways(chain, angles)
    return Smoothness(
        frames=len(angles),
        length_rad=float(record_lengths(chain, angles, DISTANCE_WEIGHT)[-1]),
        travel_rad=float(turned.sum()),
        largest_way=float(ways.max()),
        mean_way=float(ways.mean()),
        hinges_moving_mean=float(moving.mean()) if len(moving) else 0.0,
        fold_time_s=pace.top_speed,
        peak_torque=pace.peak_torque,
    )


def _ways(chain: Chain, angles: Array) -> Array:
    """(n,) the way of each module."""
    ways = np.zeros(len(chain))
    origin, upright = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for start in range(0, len(angles) - 1, CHUNK):
        centres = chain.poses(angles[start : start + CHUNK + 1], origin, upright).positions
        centres = centres - centres.mean(axis=1, keepdims=True)
        ways += np.linalg.norm(np.diff(centres, axis=0), axis=2).sum(axis=0)
    return ways
