"""Time scaling: the timing of a playback along its reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from foldback.planner.arrays import Array, Flags
from foldback.planner.chain.floating_torques import path_torques
from foldback.planner.chain.module import Module
from foldback.planner.core import torque_passes
from foldback.planner.playback.reference_curve import Reference

MIN_PLAYBACK_STEPS: Final = 100
"""Minimum number of simulation steps of a playback along a planned curve; a shorter one is slowed
down to it."""
RAMP_SHARE: Final = 0.08
"""Fraction of the duration in which a playback speeds up, and again in which it slows down, if its
speed is even in between (kinematic, or paced by hinges, or preset ``direct``)."""
STRAIGHT_SHARE: Final = 0.35
"""Fraction of a curve, from its straight end on, along which the torque bound of a patient playback
rises to that of the rest: docs/decisions/0034-calm-motion.md."""
MAX_SPEED_RATIO: Final = 2.0
"""Maximum speed along the curve of a playback whose peak torque is minimised at a given duration,
as a multiple of its mean speed."""
SCALING_STEPS: Final = 4096
"""Number of equal time intervals in which the speed profile of a kinematic or hinge-paced playback
is tabulated; times of frames are interpolated in the table."""
MAX_RESTING_SPEED_RATIO: Final = 1.25
"""Maximum speed of the fastest hinge in a motion that rests between turns, as a multiple of its
mean speed: docs/decisions/0028-turns.md."""
TORQUE_CHUNK_SAMPLES: Final = 512
"""Maximum number of points of a playback's curve whose hinge torques are computed at once."""
SMOOTHING_SAMPLES: Final = 8.0
"""Standard deviation, in samples along the planned curve, of the Gaussian filter that smooths the
speed of a playback."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeScaling:
    """Samples of u, du/dt and d²u/dt² at every step, from 0 to 1, at rest at both ends.

    Attributes:
        u, rate, acceleration: (S + 1,) u, du/dt, 1/s, and d²u/dt², 1/s².
        step_s: Time between two samples, s.
        rests: Steps in between at which the motion rests.
    """

    u: Array
    rate: Array
    acceleration: Array
    step_s: float
    rests: tuple[int, ...] = ()

    def __len__(self) -> int:
        """Return the number of steps S."""
        return len(self.u) - 1

    def backwards(self) -> TimeScaling:
        """Return the time scaling from 1 to 0 with the same torques: ü is kept, u̇ changes sign."""
        return TimeScaling(
            u=self.u[::-1],
            rate=-self.rate[::-1],
            acceleration=self.acceleration[::-1],
            step_s=self.step_s,
            rests=tuple(len(self) - frame for frame in reversed(self.rests)),
        )


def frames_kept(lengths: Array) -> Flags:
    """Return (S + 1,) True at steps where a frame is kept: the first and last, and one per unit.

    Args:
        lengths: (S + 1,) length of the curve up to each step, in the distance of two frames.
    """
    is_kept = np.concatenate([[True], np.diff(np.floor(lengths)) > 0.0])
    is_kept[-1] = True
    return is_kept


def torque_bounded_scaling(
    reference: Reference,
    module: Module,
    *,
    steps: int,
    step_s: float,
    samples: int,
    straight_torque: float = 1.0,
) -> TimeScaling:
    """Return the time scaling that bounds the largest hinge torque of a freely floating chain.

    Along the curve the torques are τ = a(u) ü + b(u) u̇². With z = u̇² and z' = 2ü, the largest z
    that keeps every |τ| ≤ 1 at the curve's ends and in between is found by a forward and a backward
    pass (Bobrow, Dubowsky, Gibson: Time-optimal control, 1985), then smoothed. The bound scales
    with 1/T², so fixing the duration fixes it.

    Args:
        reference: The curve.
        module: The kind of module that the chain is made of.
        steps: Number of steps S.
        step_s: Time step, s.
        samples: Number of samples of a and b.
        straight_torque: Ratio of the bound at u = 0, where the chain is straight, to that from
            ``STRAIGHT_SHARE`` on.
    """
    u = np.linspace(0.0, 1.0, samples)
    a, b = _torque_terms(reference, module, u)
    if straight_torque < 1.0:
        rise = np.clip(u / STRAIGHT_SHARE, 0.0, 1.0)
        bound = straight_torque + (1.0 - straight_torque) * rise * rise * (3.0 - 2.0 * rise)
        a, b = a / bound[:, None], b / bound[:, None]
    z = torque_bounded_profile(u, a, b)
    return scaling_from_profile(u, z, steps, step_s)


def _torque_terms(reference: Reference, module: Module, u: Array) -> tuple[Array, Array]:
    """Return (U, J) a and (U, J) b of the torques a ü + b u̇² at (U,) parameters."""
    a = np.empty((len(u), reference.spline.c.shape[1]))
    b = np.empty_like(a)
    for start in range(0, len(u), TORQUE_CHUNK_SAMPLES):
        part = slice(start, start + TORQUE_CHUNK_SAMPLES)
        at = u[part]
        path = reference.spline(at), reference.first(at), reference.second(at)
        a[part], b[part] = path_torques(module, *path)
    return a, b


def torque_bounded_profile(u: Array, a: Array, b: Array) -> Array:
    """Return z = u̇² of that time scaling, its torques about 1.

    Args:
        u: (U,) even parameters.
        a, b: (U, J) terms of the torques there.

    Returns:
        (U,) z, 0 at both ends.
    """
    ceiling = 1.0 / np.maximum(np.abs(b).max(axis=1), 1e-12)
    z = ceiling
    for _ in range(8):
        z = torque_passes(a, b, ceiling, u[1] - u[0])
        mean = 1.0 / duration(u, z)
        limit = (MAX_SPEED_RATIO * mean) ** 2
        if z.max() <= 1.02 * limit:
            break
        ceiling = np.minimum(ceiling, limit)
    return _smoothed(z)


def bounded_profile(u: Array, a: Array, b: Array, ceiling: Array) -> Array:
    """Return the (U,) z = u̇² that keeps |a ü + b u̇²| ≤ 1 and never exceeds a (U,) ceiling."""
    max_rates = np.minimum(ceiling, 1.0 / np.maximum(np.abs(b).max(axis=1), 1e-12))
    return _smoothed(torque_passes(a, b, max_rates, u[1] - u[0]))


def _smoothed(z: Array) -> Array:
    """Return a smooth profile that stays in the valleys of z and keeps its linear ends."""
    width = int(2 * SMOOTHING_SAMPLES) + 1
    low = -_largest_around(-z, width)
    rise = np.arange(len(z)) < width
    low = np.where(rise | rise[::-1], z, low)
    odd = np.concatenate([-low[:0:-1], low, -low[-2::-1]])
    smooth = _blurred(odd)[len(z) - 1 : 2 * len(z) - 1]
    smooth[0] = smooth[-1] = 0.0
    return np.maximum(smooth, 0.0)


def _largest_around(values: Array, width: int) -> Array:
    """Return the largest of ``width`` values around each, an odd number; the ends are repeated."""
    padded = np.pad(values, width // 2, mode="edge")
    return sliding_window_view(padded, width).max(axis=1)


def _blurred(values: Array) -> Array:
    """Return values filtered by a Gaussian; the ends are repeated."""
    reach = int(4.0 * SMOOTHING_SAMPLES)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SMOOTHING_SAMPLES) ** 2)
    padded = np.pad(values, reach, mode="edge")
    return sliding_window_view(padded, len(weights)) @ (weights / weights.sum())


def duration(u: Array, z: Array) -> float:
    """Return the time from one end to the other, in the unit of time of z."""
    root = np.sqrt(z)
    return float(np.sum(2.0 * np.diff(u) / np.maximum(root[1:] + root[:-1], 1e-12)))


def scaling_from_profile(u: Array, z: Array, steps: int, step_s: float) -> TimeScaling:
    """Return the time scaling of a profile, in a given number of steps.

    Args:
        u: (U,) parameters from 0 to 1.
        z: (U,) u̇² there, in another unit of time.
        steps: Number of steps S.
        step_s: Time step, s.
    """
    root = np.sqrt(z)
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(u) / (root[1:] + root[:-1]))])
    return _scaling_from_times(u, times, steps, step_s)


def _scaling_from_times(u: Array, times: Array, steps: int, step_s: float) -> TimeScaling:
    """Return the time scaling through parameters at increasing times, in another unit of time."""
    from scipy.interpolate import CubicSpline  # as above

    total = steps * step_s
    spline = CubicSpline(times * (total / times[-1]), u, bc_type="clamped")
    t = np.linspace(0.0, total, steps + 1)
    path_parameters = np.clip(spline(t), 0.0, 1.0)
    rate = spline(t, 1)
    acceleration = spline(t, 2)
    if rate.min() < -0.05 / total:
        return smooth_scaling(steps=steps, step_s=step_s)
    return TimeScaling(u=path_parameters, rate=rate, acceleration=acceleration, step_s=step_s)


def hinge_bounded_scaling(
    reference: Reference, *, steps: int, step_s: float, samples: int
) -> TimeScaling:
    """Return the time scaling at which the fastest hinge turns about evenly.

    It takes the least time at a given largest joint speed.

    Args:
        reference: The curve.
        steps: Number of steps S.
        step_s: Time step, s.
        samples: Number of samples of the hinges' turns.
    """
    u = np.linspace(0.0, 1.0, samples)
    steps_rad = np.abs(np.diff(reference.spline(u), axis=0)).max(axis=1)
    return _scaling_from_times(u, hinge_bounded_times(steps_rad, 1.0), steps, step_s)


def hinge_bounded_times(steps_rad: Array, seconds: float) -> Array:
    """Return times of frames at which the fastest hinge turns about evenly, slower at both ends.

    A motion whose ends go far while its hinges hardly turn needs little time for that. Where the
    fastest hinge alternates, the pace is that of the fastest around.

    Args:
        steps_rad: (F − 1,) largest turn of a hinge from each frame to the next, rad.
        seconds: Time from the first frame to the last, s.

    Returns:
        (F,) times from 0 on, s.
    """
    if not len(steps_rad):
        return np.zeros(1)
    width = int(2 * SMOOTHING_SAMPLES) + 1
    even = np.maximum(_blurred(_largest_around(steps_rad, width)), steps_rad)
    # where hinges hardly turn, but the chain's ends travel
    even = np.maximum(even, even.mean() / 4.0)
    lengths = np.concatenate([[0.0], np.cumsum(even)])
    scaling = smooth_scaling(steps=SCALING_STEPS, step_s=1.0 / SCALING_STEPS)
    shares = np.interp(
        lengths / max(lengths[-1], 1e-12), scaling.u, np.linspace(0.0, 1.0, SCALING_STEPS + 1)
    )
    return seconds * shares


def smooth_scaling(*, steps: int, step_s: float) -> TimeScaling:
    """Return the time scaling of even speed with quintic ramps over ``RAMP_SHARE`` of the time."""
    x = np.linspace(0.0, 1.0, steps + 1)
    top = 1.0 / (1.0 - RAMP_SHARE)
    y = np.clip(np.minimum(x, 1.0 - x) / RAMP_SHARE, 0.0, 1.0)
    rate = top * y**3 * (10.0 - 15.0 * y + 6.0 * y**2)
    slope = top / RAMP_SHARE * 30.0 * (y * (1.0 - y)) ** 2 * np.where(x < 0.5, 1.0, -1.0)
    risen = top * RAMP_SHARE * y**4 * (2.5 - 3.0 * y + y**2)
    u = np.where(
        x < RAMP_SHARE,
        risen,
        np.where(x > 1.0 - RAMP_SHARE, 1.0 - risen, top * (x - 0.5 * RAMP_SHARE)),
    )
    total = steps * step_s
    return TimeScaling(u=u, rate=rate / total, acceleration=slope / total**2, step_s=step_s)


def resting_scaling(rests: Array, seconds: Array, *, step_s: float) -> TimeScaling:
    """Return the time scaling that rests at some parameters, with even speed in between.

    Args:
        rests: (R,) parameters from 0 to 1.
        seconds: (R − 1,) time from each rest to the next, s; rounded up to whole steps.
        step_s: Time step, s.
    """
    parts = [smooth_scaling(steps=steps, step_s=step_s) for steps in _whole_steps(seconds, step_s)]
    return _joined(rests, parts, step_s)


def torque_bounded_resting_scaling(
    reference: Reference, module: Module, *, seconds: float, step_s: float
) -> TimeScaling:
    """Return the time scaling that rests between turns and bounds the largest hinge torque.

    Turns that move long parts take more of the time than others: the bound is the least with which
    all turns are made in time, none faster than ``MAX_RESTING_SPEED_RATIO`` allows.

    Args:
        reference: The curve, with rests.
        module: The kind of module that the chain is made of.
        seconds: Duration, s; each turn is rounded up to whole steps.
        step_s: Time step, s.
    """
    assert reference.rests is not None
    u = np.linspace(0.0, 1.0, 160)
    poses = reference.spline(reference.rests)
    turns = [_turn_terms(module, *ends, u) for ends in zip(poses[:-1], poses[1:], strict=True)]
    speed = MAX_RESTING_SPEED_RATIO * reference.length_rad / seconds
    ceilings = [(speed / turned) ** 2 for turned, _, _ in turns]

    def profiles(bound: float) -> list[Array]:
        return [
            bounded_profile(u, a / bound, b / bound, np.full(len(u), ceiling))
            for (_, a, b), ceiling in zip(turns, ceilings, strict=True)
        ]

    # With the largest bound, each turn reaches its full speed within one sample.
    high = max(
        float(ceiling * (len(u) * np.abs(a) + np.abs(b)).max())
        for (_, a, b), ceiling in zip(turns, ceilings, strict=True)
    )
    low = high * 1e-6
    for _ in range(30):  # a relative precision of 1e-8
        middle = math.sqrt(low * high)
        late = sum(duration(u, z) for z in profiles(middle)) > seconds
        low, high = (middle, high) if late else (low, middle)
    profiles_found = profiles(high)
    counts = _whole_steps(np.array([duration(u, z) for z in profiles_found]), step_s)
    return _joined(
        reference.rests,
        [
            scaling_from_profile(u, z, steps, step_s)
            for z, steps in zip(profiles_found, counts, strict=True)
        ],
        step_s,
    )


def _turn_terms(module: Module, start: Array, end: Array, u: Array) -> tuple[float, Array, Array]:
    """Return the largest turn of a hinge, rad, and (U, J) a and b of the torques a ü + b u̇².

    Args:
        module: The kind of module that the chain is made of.
        start, end: (J,) angles at rest, joined by a straight line.
        u: (U,) parameters along it.
    """
    turn = end - start
    angles = start + u[:, None] * turn
    slopes = np.broadcast_to(turn, angles.shape)
    a, b = path_torques(module, angles, slopes, np.zeros_like(angles))
    return float(np.abs(turn).max()), a, b


def _whole_steps(seconds: Array, step_s: float) -> list[int]:
    """Return the number of steps for each of some durations, rounded up."""
    return np.maximum(2, np.ceil(seconds / step_s - 1e-9).astype(np.int64)).tolist()


def _joined(rests: Array, parts: list[TimeScaling], step_s: float) -> TimeScaling:
    """Return the time scaling that goes through parts, each from one rest to the next."""
    u, rates, accelerations = [rests[:1]], [np.zeros(1)], [np.zeros(1)]
    for start, end, part in zip(rests[:-1], rests[1:], parts, strict=True):
        u.append(start + (end - start) * part.u[1:])
        rates.append((end - start) * part.rate[1:])
        accelerations.append((end - start) * part.acceleration[1:])
        u[-1][-1] = end
    return TimeScaling(
        u=np.concatenate(u),
        rate=np.concatenate(rates),
        acceleration=np.concatenate(accelerations),
        step_s=step_s,
        rests=tuple(np.cumsum([len(part) for part in parts])[:-1].tolist()),
    )
