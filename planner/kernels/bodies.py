"""Motion of all modules about one moment, with bounds that hold for a while around it, compiled.

Hinge angles run evenly: q(s) = q + s · rates for |s| ≤ half. Seen from the root module, which is
held still, a row of ``bodies`` has a module's pose, its exact first and second derivatives at s = 0
and bounds of higher ones over all |s| ≤ half:

* A hinge axis a turns with the body before it: a' = ω × a, a'' = ω' × a + ω × (ω × a). As
  ω_j = Σ rate · a over the hinges between root and j, |ω_j''| ≤ Σ |rate| (|ω'| + |ω|²) of the
  bodies before the hinges. Taylor from s = 0 then bounds |ω_j'| and |ω_j|, and so on outwards.
* Third derivatives of positions are bounded in two ways, of which the smaller is taken: link by
  link, |p'''| grows by the link's length times |R'''| ≤ |ω''| + 3 |ω| |ω'| + |ω|³; and by lever
  arms, p_j' = Σ rate · a × (p_j − c) over hinges at c, differentiated twice. There the bound of
  p_j''' is on both sides; it is solved for.

So the bounds grow with how fast things really turn and not only with the sum of the rates.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL, ZERO
from planner.kernels.kinematics import axis_rotation, copy_matrix, copy_vector, multiply
from planner.kernels.module import Joint

Array = NDArray[np.float64]

POSITION, ROTATION, VELOCITY, ACCELERATION, SPIN, TURNING = 0, 3, 12, 15, 18, 21
MOST_SPIN, MOST_TURNING, MOST_TWIST, MOST_JERK, DRIFT, RATES = 24, 25, 26, 27, 28, 29
WIDTH = 30
"""Columns of a body: pose, derivatives at s = 0; then bounds over |s| ≤ half of |ω|, |ω'|, |ω''|,
|p'''| and of the way its centre goes from s = 0, and Σ |rate| of all hinges before it."""


@njit(**INNER)
def length(x: float, y: float, z: float) -> float:
    """Of a vector."""
    return np.sqrt(x * x + y * y + z * z)


@njit(**INNER)
def _carry(body: Array, rx: float, ry: float, rz: float, point: Array, at: int) -> None:
    """Adds velocity and acceleration of a vector fixed in a body to ``point``: (v, a) at ``at``."""
    wx, wy, wz = body[SPIN], body[SPIN + 1], body[SPIN + 2]
    ux, uy, uz = body[TURNING], body[TURNING + 1], body[TURNING + 2]
    vx = wy * rz - wz * ry
    vy = wz * rx - wx * rz
    vz = wx * ry - wy * rx
    point[at] += vx
    point[at + 1] += vy
    point[at + 2] += vz
    point[at + 3] += uy * rz - uz * ry + wy * vz - wz * vy
    point[at + 4] += uz * rx - ux * rz + wz * vx - wx * vz
    point[at + 5] += ux * ry - uy * rx + wx * vy - wy * vx


@njit(**INNER)
def spatial_jerk(body: Array) -> float:
    """Bound of |R'''| of a body: what a vector fixed in it and 1 long has at most."""
    w = body[MOST_SPIN]
    return body[MOST_TWIST] + 3.0 * w * body[MOST_TURNING] + w * w * w


@njit(**KERNEL)
def rod_body(
    last: Array, place: Array, rotation: Array, half: float, turned: Array, body: Array
) -> None:
    """Writes the body of a module that is rigidly joined to the module ``last``.

    Args:
        last: (WIDTH,) the module that it moves with.
        place, rotation: (3,), (3, 3) its pose seen from there.
        half: As for the bodies.
        turned: (3, 3) scratch.
        body: (WIDTH,) written.
    """
    frame = last[ROTATION:VELOCITY].reshape((3, 3))
    multiply(frame, rotation, turned)
    copy_vector(last, body)
    copy_matrix(turned, body[ROTATION:VELOCITY].reshape((3, 3)))
    rx = frame[0, 0] * place[0] + frame[0, 1] * place[1] + frame[0, 2] * place[2]
    ry = frame[1, 0] * place[0] + frame[1, 1] * place[1] + frame[1, 2] * place[2]
    rz = frame[2, 0] * place[0] + frame[2, 1] * place[1] + frame[2, 2] * place[2]
    body[0] += rx
    body[1] += ry
    body[2] += rz
    _carry(last, rx, ry, rz, body, VELOCITY)
    away = length(rx, ry, rz)
    body[MOST_JERK] += away * spatial_jerk(last)
    body[DRIFT] += away * min(2.0, half * last[MOST_SPIN])


@njit(**INNER)
def _outwards(
    angles: Array,
    rates: Array,
    half: float,
    joint: Joint,
    root: int,
    step: int,
    bodies: Array,
) -> None:
    """Bodies from the root to one end; ``step`` is 1 or −1."""
    rigid_links, anchor, axes, turn, offset = joint
    hinges = axes.shape[0]
    out = length(anchor[0], anchor[1], anchor[2])
    back = length(offset[0], offset[1], offset[2])
    near_arm, far_arm = (out, back) if step > 0 else (back, out)
    frame = np.empty((3, 3))
    hinge = np.empty((3, 3))
    work = np.empty((3, 3))
    centre = np.empty(9)
    state = np.empty(WIDTH)
    origin = bodies[root, :3].copy()
    # Sums over hinges of |rate| · (|a''|, |a''| reach, |a'|, |a'| speed, 1, acceleration).
    bend = bend_far = sway = sway_fast = total = total_hard = 0.0
    here = root
    last = bodies.shape[0] - 1 if step > 0 else 0
    while here != last:
        there = here + step
        a = bodies[here]
        copy_vector(a, state)
        link = min(here, there) - rigid_links
        copy_matrix(a[ROTATION:VELOCITY].reshape((3, 3)), frame)
        arm = anchor if step > 0 else offset
        for r in range(3):
            reach = frame[r, 0] * arm[0] + frame[r, 1] * arm[1] + frame[r, 2] * arm[2]
            work[0, r] = reach if step > 0 else -reach
            centre[r] = a[r] + work[0, r]
            centre[3 + r] = a[VELOCITY + r]
            centre[6 + r] = a[ACCELERATION + r]
        _carry(a, work[0, 0], work[0, 1], work[0, 2], centre, 3)
        if step < 0:
            multiply(frame, turn.T, work)
            copy_matrix(work, frame)
        if link >= 0:
            w, u = a[MOST_SPIN], a[MOST_TURNING]
            jerk = a[MOST_JERK]
            speed = length(a[12], a[13], a[14])
            hard = length(a[15], a[16], a[17])
            far = length(a[0] - origin[0], a[1] - origin[1], a[2] - origin[2])
            far += a[DRIFT] + near_arm
            fast = speed + half * (hard + 0.5 * half * jerk) + near_arm * w
            hard += half * jerk + near_arm * (u + w * w)
            for at in range(hinges):
                k = at if step > 0 else hinges - 1 - at
                rate = rates[link * hinges + k]
                angle = float(angles[link * hinges + k])
                if rate != 0.0:
                    x = frame[0, 0] * axes[k, 0] + frame[0, 1] * axes[k, 1]
                    y = frame[1, 0] * axes[k, 0] + frame[1, 1] * axes[k, 1]
                    z = frame[2, 0] * axes[k, 0] + frame[2, 1] * axes[k, 1]
                    x += frame[0, 2] * axes[k, 2]
                    y += frame[1, 2] * axes[k, 2]
                    z += frame[2, 2] * axes[k, 2]
                    signed = rate * step
                    sx, sy, sz = state[SPIN], state[SPIN + 1], state[SPIN + 2]
                    state[TURNING] += signed * (sy * z - sz * y)
                    state[TURNING + 1] += signed * (sz * x - sx * z)
                    state[TURNING + 2] += signed * (sx * y - sy * x)
                    state[SPIN] += signed * x
                    state[SPIN + 1] += signed * y
                    state[SPIN + 2] += signed * z
                    size = abs(rate)
                    w, u = state[MOST_SPIN], state[MOST_TURNING]
                    bend += size * (u + w * w)
                    bend_far += size * (u + w * w) * far
                    sway += size * w
                    sway_fast += size * w * fast
                    total += size
                    total_hard += size * hard
                    twist = state[MOST_TWIST] + size * (u + w * w)
                    state[MOST_TWIST] = twist
                    u = length(state[21], state[22], state[23])
                    w = length(state[18], state[19], state[20])
                    state[MOST_TURNING] = min(u + half * twist, 0.5 * total * total)
                    state[MOST_SPIN] = min(w + half * (u + 0.5 * half * twist), total)
                if angle != 0.0:
                    axis_rotation(axes[k], angle * step, hinge)
                    multiply(frame, hinge, work)
                    copy_matrix(work, frame)
        if step > 0:
            multiply(frame, turn, work)
            copy_matrix(work, frame)
        b = bodies[there]
        copy_vector(state, b)
        copy_matrix(frame, b[ROTATION:VELOCITY].reshape((3, 3)))
        arm = offset if step > 0 else anchor
        for r in range(3):
            reach = frame[r, 0] * arm[0] + frame[r, 1] * arm[1] + frame[r, 2] * arm[2]
            work[0, r] = reach if step > 0 else -reach
            b[r] = centre[r] + work[0, r]
            b[VELOCITY + r] = centre[3 + r]
            b[ACCELERATION + r] = centre[6 + r]
        _carry(b, work[0, 0], work[0, 1], work[0, 2], b, VELOCITY)
        jerk = a[MOST_JERK] + near_arm * spatial_jerk(a) + far_arm * spatial_jerk(b)
        speed = length(b[12], b[13], b[14])
        hard = length(b[15], b[16], b[17])
        left = 1.0 - half * (total + half * (sway + half * bend / 6.0))
        if left > 0.0:
            far = length(b[0] - origin[0], b[1] - origin[1], b[2] - origin[2])
            far += half * (speed + 0.5 * half * hard)
            lever = bend * far + bend_far + total * hard + total_hard
            lever += 2.0 * (sway * (speed + half * hard) + sway_fast)
            jerk = min(jerk, lever / left)
        b[MOST_JERK] = jerk
        b[DRIFT] = min(
            half * (speed + half * (0.5 * hard + half * jerk / 6.0)),
            half * total * abs(there - root) * (out + back),
        )
        b[RATES] = bodies[root, RATES] + step * total
        here = there


@njit(**KERNEL)
def move_bodies(
    angles: Array,
    rates: Array,
    half: float,
    joint: Joint,
    root: int,
    bodies: Array,
) -> None:
    """Writes all bodies of a stretch of a chain.

    Args:
        angles, rates: Hinge angles at s = 0 and how fast they run, for the stretch's joints.
        half: How far s goes both ways.
        joint: The module's joint; its rigid links are those at the stretch's start.
        root: The body that is held still; its pose is given.
        bodies: (m, WIDTH) written.
    """
    bodies[root, VELOCITY:] = 0.0
    _outwards(angles, rates, half, joint, root, ZERO + 1, bodies)
    _outwards(angles, rates, half, joint, root, ZERO - 1, bodies)
