"""How much of its clearance a pair of modules can lose around one moment, compiled.

A plane with unit normal n stays as it is seen from module i. A point r of module j, at
x(s) + Q(s) r as seen from i, nears that plane by no more than the first and second derivative at
s = 0 along n say, plus a bound of the third one: Taylor, so it is a bound and no estimate.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import KERNEL
from planner.kernels.bodies import (
    ACCELERATION,
    MOST_JERK,
    MOST_SPIN,
    MOST_TURNING,
    MOST_TWIST,
    RATES,
    SPIN,
    TURNING,
    VELOCITY,
    length,
    spatial_jerk,
)

Array = NDArray[np.float64]
SLIDE, PULL, ROLL, REST = 0, 3, 6, 9
WIDTH = 10
"""Columns of an approach: velocity, acceleration and spin of j as seen from i (9), then a bound on
how far any point of j gets besides these."""


@njit(**KERNEL)
def approach(
    a: Array, b: Array, half: float, radius: float, arm: float, found: Array
) -> tuple[float, float]:
    """How body b moves as seen from body a.

    Args:
        a, b: (…,) bodies, see ``planner.kernels.bodies``.
        half: How far s goes both ways.
        radius: Of the modules.
        arm: What the chain between them that moves is at most long.
        found: (WIDTH,) written.

    Returns:
        How near any point of b may get to a from where it is at s = 0, and the centres' distance.
    """
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    wx, wy, wz = a[SPIN], a[SPIN + 1], a[SPIN + 2]
    tx, ty, tz = a[TURNING], a[TURNING + 1], a[TURNING + 2]
    vx = b[VELOCITY] - a[VELOCITY]
    vy = b[VELOCITY + 1] - a[VELOCITY + 1]
    vz = b[VELOCITY + 2] - a[VELOCITY + 2]
    ax = b[ACCELERATION] - a[ACCELERATION]
    ay = b[ACCELERATION + 1] - a[ACCELERATION + 1]
    az = b[ACCELERATION + 2] - a[ACCELERATION + 2]
    cx, cy, cz = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx
    # The velocity seen from a is v − ω × d, the acceleration a − ω' × d − 2 ω × v + ω × (ω × d).
    ux, uy, uz = vx - cx, vy - cy, vz - cz
    ex, ey, ez = cx - 2.0 * vx, cy - 2.0 * vy, cz - 2.0 * vz
    px = ax - (ty * dz - tz * dy) + wy * ez - wz * ey
    py = ay - (tz * dx - tx * dz) + wz * ex - wx * ez
    pz = az - (tx * dy - ty * dx) + wx * ey - wy * ex
    yx, yy, yz = b[SPIN] - wx, b[SPIN + 1] - wy, b[SPIN + 2] - wz
    sx, sy, sz = b[TURNING] - tx, b[TURNING + 1] - ty, b[TURNING + 2] - tz
    zx, zy, zz = sx - (wy * yz - wz * yy), sy - (wz * yx - wx * yz), sz - (wx * yy - wy * yx)
    distance = length(dx, dy, dz)
    rates = abs(b[RATES] - a[RATES])
    cube = rates * rates * rates
    # Bounds over the while: of d and its derivatives, then of what a sees.
    w, u = a[MOST_SPIN], a[MOST_TURNING]
    hard = length(ax, ay, az)
    jerk = a[MOST_JERK] + b[MOST_JERK]
    fast = length(vx, vy, vz) + half * (hard + 0.5 * half * jerk)
    hard += half * jerk
    far = distance + half * fast
    jerk += 3.0 * (w * hard + (u + w * w) * fast) + spatial_jerk(a) * far
    jerk = min(jerk, cube * arm)
    roll = length(yx, yy, yz)
    rolling = length(zx, zy, zz)
    twist = a[MOST_TWIST] + b[MOST_TWIST]
    spin = roll + half * (length(sx, sy, sz) + 0.5 * half * twist)
    twist += 2.0 * w * (u + b[MOST_TURNING]) + (u + w * w) * spin
    twist = min(twist, 0.5 * cube)
    most_turning = rolling + half * twist
    most_roll = min(roll + half * (rolling + 0.5 * half * twist), rates)
    around = min(twist + 3.0 * most_roll * most_turning + most_roll * most_roll * most_roll, cube)
    found[SLIDE], found[SLIDE + 1], found[SLIDE + 2] = ux, uy, uz
    found[PULL], found[PULL + 1], found[PULL + 2] = px, py, pz
    found[ROLL], found[ROLL + 1], found[ROLL + 2] = yx, yy, yz
    found[REST] = 0.5 * half * half * radius * (rolling + roll * roll)
    found[REST] += half * half * half / 6.0 * (jerk + radius * around)
    slide = length(ux, uy, uz)
    pull = length(px, py, pz)
    return half * (slide + 0.5 * half * pull + radius * roll) + found[REST], distance


@njit(**KERNEL)
def loss_along(found: Array, axis: Array, half: float, radius: float) -> float:
    """How far any point of b may get along a unit axis (3,) that is fixed in a."""
    x, y, z = axis[0], axis[1], axis[2]
    slide = abs(x * found[SLIDE] + y * found[SLIDE + 1] + z * found[SLIDE + 2])
    pull = abs(x * found[PULL] + y * found[PULL + 1] + z * found[PULL + 2])
    rx, ry, rz = found[ROLL], found[ROLL + 1], found[ROLL + 2]
    roll = length(y * rz - z * ry, z * rx - x * rz, x * ry - y * rx)
    return half * (slide + 0.5 * half * pull + radius * roll) + found[REST]
