"""Bounds on the loss of clearance of a pair of modules, by motion and by errors, compiled.

Lemmas 5, 6, 11 and 12 of docs/decisions/0012-sweep-bound.md. A plane with unit normal n stays as
it is seen from module a. A point r of module b, at x(s) + Q(s) r as seen from a, nears that plane
by no more than the first and second derivative at s = 0 along n say, plus a bound of the third one.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.motion_bounds import (
    ACCELERATION,
    ANGULAR_ACCELERATION,
    ANGULAR_ACCELERATION_BOUND,
    ANGULAR_JERK_BOUND,
    ANGULAR_SPEED_BOUND,
    ANGULAR_VELOCITY,
    DISPLACEMENT_BOUND,
    JERK_BOUND,
    RATE_SUM,
    ROTATION,
    VELOCITY,
    length,
    rotation_jerk_bound,
)

Array = NDArray[np.float64]
REL_VELOCITY, REL_ACCELERATION, REL_ANGULAR_VELOCITY, REMAINDER = 0, 3, 6, 9
"""First columns of a relative motion: u, e and ψ of lemma 5 (3 each), velocity, acceleration and
angular velocity of b as seen from a at s = 0; then the bound of how near any point of b gets
besides these (lemma 6)."""
RELATIVE_COLUMNS = 10
"""Number of columns of a row that describes the motion of one module relative to another: velocity,
acceleration and angular velocity (3 each), and a bound of the remaining motion (1)."""


@njit(**INNER, inline="always")  # called, it slows the sweep
def _third_derivative_bound(
    a: Array,
    b: Array,
    half: float,
    radius: float,
    links: float,
    centre: tuple[float, float, float],
    turn: tuple[float, float, float],
) -> float:
    """Return the bound X + ρ Q of the third derivative of any point of b as seen from a: lemma 5.

    Args:
        a, b, half, radius, links: As for ``relative_motion_bound``.
        centre: |d|, |d'| and |d''| at s = 0.
        turn: |ψ|, |ψ'| and |y'| at s = 0.
    """
    distance, speed, acceleration = centre
    spin, spin_rate, difference_rate = turn
    rates = abs(b[RATE_SUM] - a[RATE_SUM])  # S
    cube = rates * rates * rates
    w, u = a[ANGULAR_SPEED_BOUND], a[ANGULAR_ACCELERATION_BOUND]
    # Taylor bounds |d|, |d'| and |d''| over the interval; then X.
    jerk = a[JERK_BOUND] + b[JERK_BOUND]
    speed = speed + half * (acceleration + 0.5 * half * jerk)
    acceleration += half * jerk
    distance += half * speed
    jerk += 3.0 * (w * acceleration + (u + w * w) * speed) + rotation_jerk_bound(a) * distance
    jerk = min(jerk, cube * links)
    # The same for |y|, then Ψ, the bounds of |ψ'| and |ψ|, and Q.
    angular_jerk = a[ANGULAR_JERK_BOUND] + b[ANGULAR_JERK_BOUND]
    difference = spin + half * (difference_rate + 0.5 * half * angular_jerk)
    angular_jerk += 2.0 * w * (u + b[ANGULAR_ACCELERATION_BOUND]) + (u + w * w) * difference
    angular_jerk = min(angular_jerk, 0.5 * cube)
    max_spin_rate = spin_rate + half * angular_jerk
    max_spin = min(spin + half * (spin_rate + 0.5 * half * angular_jerk), rates)
    rotation_jerk = angular_jerk + 3.0 * max_spin * max_spin_rate + max_spin * max_spin * max_spin
    return jerk + radius * min(rotation_jerk, cube)


@njit(**KERNEL)
def relative_motion_bound(
    a: Array, b: Array, half: float, radius: float, links: float, relative: Array
) -> tuple[float, float]:
    """Bound how near body b gets to body a: lemmas 5 and 6.

    Args:
        a, b: (BODY_COLUMNS,) bodies, see ``planner.kernels.motion_bounds``.
        half: h: the interval is |s| ≤ h.
        radius: ρ, of the ball about a module.
        links: k, links between the two that move against each other.
        relative: (RELATIVE_COLUMNS,) written.

    Returns:
        Pitches by which any point of b may get nearer to a than at s = 0, along whatever axis; and
        the distance of the centres at s = 0.
    """
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    wx, wy, wz = a[ANGULAR_VELOCITY], a[ANGULAR_VELOCITY + 1], a[ANGULAR_VELOCITY + 2]
    tx = a[ANGULAR_ACCELERATION]
    ty = a[ANGULAR_ACCELERATION + 1]
    tz = a[ANGULAR_ACCELERATION + 2]
    vx = b[VELOCITY] - a[VELOCITY]
    vy = b[VELOCITY + 1] - a[VELOCITY + 1]
    vz = b[VELOCITY + 2] - a[VELOCITY + 2]
    ax = b[ACCELERATION] - a[ACCELERATION]
    ay = b[ACCELERATION + 1] - a[ACCELERATION + 1]
    az = b[ACCELERATION + 2] - a[ACCELERATION + 2]
    cx, cy, cz = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx  # ω × d
    # Lemma 5: u = d' − ω × d and e = d'' − ω' × d − 2 ω × d' + ω × (ω × d).
    ux, uy, uz = vx - cx, vy - cy, vz - cz
    ex, ey, ez = cx - 2.0 * vx, cy - 2.0 * vy, cz - 2.0 * vz
    px = ax - (ty * dz - tz * dy) + wy * ez - wz * ey
    py = ay - (tz * dx - tx * dz) + wz * ex - wx * ez
    pz = az - (tx * dy - ty * dx) + wx * ey - wy * ex
    # ψ = y = ω_b − ω_a, and ψ' = y' − ω_a × y.
    yx = b[ANGULAR_VELOCITY] - wx
    yy = b[ANGULAR_VELOCITY + 1] - wy
    yz = b[ANGULAR_VELOCITY + 2] - wz
    sx = b[ANGULAR_ACCELERATION] - tx
    sy = b[ANGULAR_ACCELERATION + 1] - ty
    sz = b[ANGULAR_ACCELERATION + 2] - tz
    zx, zy, zz = sx - (wy * yz - wz * yy), sy - (wz * yx - wx * yz), sz - (wx * yy - wy * yx)
    relative[REL_VELOCITY], relative[REL_VELOCITY + 1], relative[REL_VELOCITY + 2] = ux, uy, uz
    relative[REL_ACCELERATION] = px
    relative[REL_ACCELERATION + 1] = py
    relative[REL_ACCELERATION + 2] = pz
    relative[REL_ANGULAR_VELOCITY] = yx
    relative[REL_ANGULAR_VELOCITY + 1] = yy
    relative[REL_ANGULAR_VELOCITY + 2] = yz
    distance = length(dx, dy, dz)
    spin, spin_rate = length(yx, yy, yz), length(zx, zy, zz)
    third = _third_derivative_bound(
        a,
        b,
        half,
        radius,
        links,
        (distance, length(vx, vy, vz), length(ax, ay, az)),
        (spin, spin_rate, length(sx, sy, sz)),
    )
    relative[REMAINDER] = 0.5 * half * half * radius * (spin_rate + spin * spin)
    relative[REMAINDER] += half * half * half / 6.0 * third
    speed = length(ux, uy, uz)
    acceleration = length(px, py, pz)
    loss = half * (speed + 0.5 * half * acceleration + radius * spin) + relative[REMAINDER]
    return loss, distance


@njit(**KERNEL)
def directional_motion_bound(relative: Array, axis: Array, half: float, radius: float) -> float:
    """Return loss(n) of lemma 6: how near any point of b gets along an axis fixed in a.

    Args:
        relative: (RELATIVE_COLUMNS,) of ``relative_motion_bound``.
        axis: (3,) n, of length 1.
        half, radius: h and ρ.
    """
    x, y, z = axis[0], axis[1], axis[2]
    speed = abs(
        x * relative[REL_VELOCITY] + y * relative[REL_VELOCITY + 1] + z * relative[REL_VELOCITY + 2]
    )
    acceleration = abs(
        x * relative[REL_ACCELERATION]
        + y * relative[REL_ACCELERATION + 1]
        + z * relative[REL_ACCELERATION + 2]
    )
    rx = relative[REL_ANGULAR_VELOCITY]
    ry = relative[REL_ANGULAR_VELOCITY + 1]
    rz = relative[REL_ANGULAR_VELOCITY + 2]
    spin = length(y * rz - z * ry, z * rx - x * rz, x * ry - y * rx)
    return half * (speed + 0.5 * half * acceleration + radius * spin) + relative[REMAINDER]


class Tolerance(NamedTuple):
    """Errors of hinges that a motion must stand: those of one hinge, and those of all hinges.

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
    near = tolerance.one_hinge_rad * lever.longest
    epsilon = tolerance.each_hinge_rad
    if epsilon > 0.0:
        count, total = hinges * joints, hinges * lever.total
        if epsilon * count >= 1.0:
            return np.inf
        moved = epsilon * total / (1.0 - epsilon * count)  # Δ of lemma 12
        squares = hinges * lever.squares + moved * (2.0 * total + count * moved)
        deviation = epsilon * tolerance.deviations * np.sqrt(squares)
        deviation += 0.5 * epsilon * epsilon * (total + count * moved)
        near = max(near, deviation)
    return tolerance.spare + near


@njit(**INNER)
def write_largest_allowances(
    tolerance: Tolerance, extent: float, arm: float, hinges: float, out: Array
) -> None:
    """Write the largest allowance of any two modules k links apart to ``out[k]``, in pitches.

    Neighbouring centres are at most one pitch apart, so that the c-th joint from a module is at
    most c away from its centre, and at most ``extent``.

    Args:
        tolerance: The errors.
        extent: Largest distance of the centres of two modules, in pitches.
        arm: As for ``levers``.
        hinges: Number of hinges of a joint.
        out: (n,) written.
    """
    total = squares = 0.0
    for k in range(out.shape[0]):
        longest = min(extent, float(k // 2)) + arm
        out[k] = allowance(tolerance, Levers(longest, total, squares), float(k), hinges)
        lever = min(extent, float(k + 1)) + arm
        total += lever
        squares += lever * lever
