"""Substeps: steps of a playback that are divided for robots in MuJoCo.

MuJoCo limits the torque of a servo as a step begins, before the damping of the step itself. That
torque is τ + kv h q̈: that of the target, and the damping of the change of its rate in the step. So
steps in which it is beyond the motors' limit are divided.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.chain.module import Module
from foldback.planner.playback.reference_curve import Reference
from foldback.planner.playback.time_scaling import TimeScaling
from foldback.planner.simulation.mujoco_robot import Substeps

MAX_SERVO_SHARE: Final = 0.95
"""Maximum torque of servos as steps begin, as a fraction of the motors' limit; the rest is for
model errors. Measured in docs/decisions/0058-a-robot-by-mujoco.md."""
SPREAD_STEPS: Final = 8
"""Number of steps on either side of a divided one that are divided, too."""
MAX_SUBSTEPS: Final = 16
"""Maximum number of steps of MuJoCo for one step of a playback."""
MAX_LOCAL_DIVISIONS: Final = 6
"""Maximum number of times that some steps are divided; after that, all are. Most playbacks need 2
to 6."""


def divided_steps(
    reference: Reference, scaling: TimeScaling, module: Module, *, limit: float, damping: float
) -> list[Substeps]:
    """Return the S steps of a time scaling, and one in which its end is held, divided.

    Args:
        reference: The curve.
        scaling: Time scaling of S steps along it.
        module: The kind of module that the chain is made of.
        limit: Largest torque of a motor.
        damping: kv of the servos, torque per rad/s.
    """
    counts = np.ones(len(scaling) + 1, dtype=np.int64)
    divisions = 0
    while True:
        parts = _parts_of(reference, scaling, module, counts)
        servos = np.abs(parts.torques + damping * parts.changes).max(axis=1)
        beyond = servos > MAX_SERVO_SHARE * limit
        if not beyond.any() or counts[:-1].min() == MAX_SUBSTEPS:
            break
        divisions += 1
        if divisions <= MAX_LOCAL_DIVISIONS:
            counts = _divided_around(counts, beyond)
        else:
            counts[:-1] = 2 ** (divisions - MAX_LOCAL_DIVISIONS)
    ends = np.cumsum(counts)
    return [
        Substeps(
            step_s=scaling.step_s / int(stop - first),
            angles=parts.angles[first:stop],
            rates=parts.rates[first:stop],
            torques=parts.torques[first:stop],
        )
        for first, stop in zip(ends - counts, ends, strict=True)
    ]


class _Parts(NamedTuple):
    """(N, J) targets of all parts of all steps, as in ``Substeps``, and changes of rates."""

    angles: Array
    rates: Array
    changes: Array
    torques: Array


def _parts_of(reference: Reference, scaling: TimeScaling, module: Module, counts: Ints) -> _Parts:
    """Return the targets of steps that are divided into (S + 1,) numbers of parts."""
    steps_s = np.repeat(scaling.step_s / counts, counts)[:, None]
    angles = reference.spline(_parameters(scaling, counts))
    rates = np.diff(angles, axis=0) / steps_s
    before = np.concatenate([np.zeros_like(rates[:1]), rates[:-1]])
    # Semi-implicit Euler follows these to the last digit, as in ``setpoints``.
    torques = floating_torques(module, angles[:-1], before, (rates - before) / steps_s)
    return _Parts(angles[:-1], rates, rates - before, torques)


def _divided_around(counts: Ints, beyond: Flags) -> Ints:
    """Return larger numbers of parts of some steps and those around them.

    A part that follows one twice as long needs one and a half times the torque, and more if that is
    longer. So steps around it are divided, too, and it is not if it is such a part.

    Args:
        counts: (S + 1,) numbers of parts.
        beyond: (N,) True for parts of all steps, in order, whose servos are beyond their limit.
    """
    of = np.repeat(np.arange(len(counts)), counts)
    is_first = np.concatenate([[True], np.diff(of) > 0])
    follows_longer = is_first & (counts[np.maximum(of - 1, 0)] < counts[of])
    finer = counts.copy()
    finer[of[beyond & ~follows_longer]] *= 2
    for k in np.unique(of[beyond]):
        around = finer[max(0, k - SPREAD_STEPS) : k + SPREAD_STEPS + 1]
        np.maximum(around, finer[k], out=around)
    for k in range(len(finer) - 1, 0, -1):
        finer[k - 1] = max(finer[k - 1], finer[k] // 2)
    finer[-1] = 1  # the motion stops in it, and the shorter, the harder
    return np.minimum(finer, MAX_SUBSTEPS)


def _parameters(scaling: TimeScaling, counts: Ints) -> Array:
    """Return parameters of a curve at all parts of all steps, and at the end of the last one.

    In a step they are a cubic, with the slopes of parabolas through each sample and its neighbours,
    or at rest.

    Args:
        scaling: Time scaling of S steps along it, which rests at both ends.
        counts: (S + 1,) numbers of parts of the steps; the last step rests.
    """
    samples = scaling.u
    u = np.concatenate([samples[:1], samples, samples[-1:], samples[-1:]])
    slopes = 0.5 * (u[2:] - u[:-2])
    slopes[[0, *scaling.rests, len(scaling)]] = 0.0
    turns, first, last = np.diff(u[1:-1]), slopes[:-1], slopes[1:]
    of = np.repeat(np.arange(len(counts)), counts)
    s = (np.arange(len(of)) - (np.cumsum(counts) - counts)[of]) / counts[of]
    square, cube = 3.0 * turns - 2.0 * first - last, first + last - 2.0 * turns
    inside = u[1:-2][of] + s * (first[of] + s * (square[of] + s * cube[of]))
    return np.clip(np.append(inside, samples[-1]), 0.0, 1.0)
