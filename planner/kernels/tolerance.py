"""Distance by which errors of hinges bring two modules nearer to each other, compiled.

Lemmas 11 and 12 of docs/decisions/0012-sweep-bound.md.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.motion_bounds import (
    ANGULAR_SPEED_BOUND,
    DISPLACEMENT_BOUND,
    ROTATION,
    VELOCITY,
    length,
)

Array = NDArray[np.float64]


class Tolerance(NamedTuple):
    """Errors of hinges that a motion must stand.

    Attributes:
        one_hinge_rad: Error of any one hinge while all others are exact, at any moment, in radians.
        each_hinge_rad: ε, largest error of each hinge, independent of the others, in radians.
        deviations: κ of lemma 12: how many standard deviations of a sum of errors are covered.
        spare: Distance in pitches that must remain besides.
    """

    one_hinge_rad: float
    each_hinge_rad: float
    deviations: float
    spare: float


class Levers(NamedTuple):
    """Distances of the joints between two modules a and b from points of these, in pitches.

    Attributes:
        longest: Largest over the joints of the smaller distance, from points of a or b: lemma 11.
        total, squares: Sum of the distances from points of b, and of their squares: lemma 12.
    """

    longest: float
    total: float
    squares: float


@njit(**INNER)
def levers(
    a: Array,
    b: Array,
    joints: tuple[int, int, int],
    core: Array,
    bodies: Array,
    tail: Array,
    arm: float,
    half: float,
    share: float,
) -> Levers:
    """Return bounds of the levers of a pair over the interval |s| ≤ h, or the levers at s = 0.

    Args:
        a, b: (BODY_COLUMNS,) the two modules.
        joints: Modules before the first joint and after the last one, and first moving module.
        core, bodies: Rows of the folded and of the moving modules.
        tail: (n, 3) centres of a straight tail in the frame of its first module.
        arm: Farthest that any point of a or b is from its centre, plus that of a joint from the
            centre of the module before it.
        half: h.
        share: 1 for the interval, 0 for s = 0: what displacements (lemma 4) count for.
    """
    first, end, low = joints
    last = bodies[bodies.shape[0] - 1]
    frame = last[ROTATION:VELOCITY].reshape((3, 3))
    sway = min(2.0, half * last[ANGULAR_SPEED_BOUND])
    longest = total = squares = 0.0
    for k in range(first, end):
        at = k - low
        if at < 0:
            x, y, z, moved = core[k, 0], core[k, 1], core[k, 2], 0.0
        elif at < bodies.shape[0]:
            body = bodies[at]
            x, y, z, moved = body[0], body[1], body[2], body[DISPLACEMENT_BOUND]
        else:
            place = tail[at - bodies.shape[0] + 1]
            x = last[0] + frame[0, 0] * place[0] + frame[0, 1] * place[1] + frame[0, 2] * place[2]
            y = last[1] + frame[1, 0] * place[0] + frame[1, 1] * place[1] + frame[1, 2] * place[2]
            z = last[2] + frame[2, 0] * place[0] + frame[2, 1] * place[1] + frame[2, 2] * place[2]
            moved = last[DISPLACEMENT_BOUND] + sway * length(place[0], place[1], place[2])
        from_a = length(x - a[0], y - a[1], z - a[2]) + arm
        from_a += share * (a[DISPLACEMENT_BOUND] + moved)
        from_b = length(x - b[0], y - b[1], z - b[2]) + arm
        from_b += share * (b[DISPLACEMENT_BOUND] + moved)
        longest = max(longest, min(from_a, from_b))
        total += from_b
        squares += from_b * from_b
    return Levers(longest, total, squares)


@njit(**KERNEL)
def allowance(tolerance: Tolerance, lever: Levers, joints: float, hinges: float) -> float:
    """Return the distance by which errors bring two modules nearer, in pitches; ∞ if unbounded.

    Args:
        tolerance: The errors.
        lever: Bounds of the levers of the pair.
        joints: Number of joints between the two.
        hinges: Number of hinges of a joint.
    """
    near = tolerance.spare + tolerance.one_hinge_rad * lever.longest
    epsilon = tolerance.each_hinge_rad
    if epsilon > 0.0:
        count, total = hinges * joints, hinges * lever.total
        if epsilon * count >= 1.0:
            return np.inf
        moved = epsilon * total / (1.0 - epsilon * count)  # Δ of lemma 12
        squares = hinges * lever.squares + moved * (2.0 * total + count * moved)
        near += epsilon * tolerance.deviations * np.sqrt(squares)
        near += 0.5 * epsilon * epsilon * (total + count * moved)
    return near


@njit(**INNER)
def largest_allowance(tolerance: Tolerance, lever: float, joints: float, hinges: float) -> float:
    """Return the allowance of a pair of which each lever is at most ``lever``."""
    each = Levers(lever, joints * lever, joints * lever * lever)
    return allowance(tolerance, each, joints, hinges)
