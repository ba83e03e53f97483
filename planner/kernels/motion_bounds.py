"""Motion of all modules about one moment, with bounds over an interval around it, compiled.

Lemmas 1 to 4 of docs/decisions/0012-sweep-bound.md. Hinge angles run evenly: q(s) = q + s q̇ for
|s| ≤ h. In the frame of the root module, which is held still, a row of ``bodies`` holds a module's
pose, its exact first and second derivatives at s = 0, and bounds of higher ones over all |s| ≤ h.
Lengths are in pitches; a unit of time is the interval between two frames.

The bounds grow with actual angular velocities, and not only with the sum of the hinge rates.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO
from foldback.planner.kernels.kinematics import axis_rotation, copy_matrix, copy_vector, multiply
from foldback.planner.kernels.module import Joint

Array = NDArray[np.float64]

POSITION, ROTATION, VELOCITY, ACCELERATION = 0, 3, 12, 15
"""First columns of a body's p (3), R (9, row by row), v (3) and a (3) at s = 0."""
ANGULAR_VELOCITY, ANGULAR_ACCELERATION = 18, 21
"""First columns of a body's ω and ω' (3 each) at s = 0."""
ANGULAR_SPEED_BOUND, ANGULAR_ACCELERATION_BOUND, ANGULAR_JERK_BOUND = 24, 25, 26
"""Columns of the bounds W, A and T of |ω|, |ω'| and |ω''| over |s| ≤ h: lemma 2."""
JERK_BOUND, DISPLACEMENT_BOUND, RATE_SUM = 27, 28, 29
"""Columns of the bound J of |p'''| (lemma 3), of the bound D of the centre's displacement from
s = 0 (lemma 4), and of Σ|q̇| over the hinges from the root on, negative on the other side of it."""
BODY_COLUMNS = 30
"""Number of columns of a row that describes the motion of one module about a moment: pose, first
and second derivatives, and bounds of higher ones over the interval around that moment."""


class JointBounds(NamedTuple):
    """Bounds over |s| ≤ h for the centre c of a joint: lemma 3.

    Attributes:
        distance: Of |c − p| to the root's centre p, in pitches.
        speed: Of |c'|.
        acceleration: Of |c''|.
    """

    distance: float
    speed: float
    acceleration: float


class LeverSums(NamedTuple):
    """Sums of |q̇| times bounds over the hinges between the root and a module: lemmas 2 and 3.

    The axis of a hinge is n, the centre of its joint c.

    Attributes:
        rate: Σ |q̇|.
        axis_speed: Σ |q̇| |n'|.
        axis_acceleration: Σ |q̇| |n''|.
        axis_speed_times_speed: Σ |q̇| |n'| |c'|.
        axis_acceleration_times_distance: Σ |q̇| |n''| |c|.
        acceleration: Σ |q̇| |c''|.
    """

    rate: float
    axis_speed: float
    axis_acceleration: float
    axis_speed_times_speed: float
    axis_acceleration_times_distance: float
    acceleration: float


@njit(**INNER)
def length(x: float, y: float, z: float) -> float:
    """Return the Euclidean norm of (x, y, z)."""
    return np.sqrt(x * x + y * y + z * z)


@njit(**INNER)
def _rotate(rotation: Array, vector: Array) -> tuple[float, float, float]:
    """Return the product of a (3, 3) matrix and a (3,) vector."""
    return (
        rotation[0, 0] * vector[0] + rotation[0, 1] * vector[1] + rotation[0, 2] * vector[2],
        rotation[1, 0] * vector[0] + rotation[1, 1] * vector[1] + rotation[1, 2] * vector[2],
        rotation[2, 0] * vector[0] + rotation[2, 1] * vector[1] + rotation[2, 2] * vector[2],
    )


@njit(**INNER)
def _shift(body: Array, rx: float, ry: float, rz: float, point: Array) -> None:
    """Move ``point`` by a vector r fixed in a body: lemma 1.

    Adds r to its position, ω × r to its velocity, ω' × r + ω × (ω × r) to its acceleration.
    ``point`` may be ``body``.
    """
    wx, wy, wz = body[ANGULAR_VELOCITY], body[ANGULAR_VELOCITY + 1], body[ANGULAR_VELOCITY + 2]
    ux = body[ANGULAR_ACCELERATION]
    uy = body[ANGULAR_ACCELERATION + 1]
    uz = body[ANGULAR_ACCELERATION + 2]
    vx = wy * rz - wz * ry
    vy = wz * rx - wx * rz
    vz = wx * ry - wy * rx
    point[POSITION] += rx
    point[POSITION + 1] += ry
    point[POSITION + 2] += rz
    point[VELOCITY] += vx
    point[VELOCITY + 1] += vy
    point[VELOCITY + 2] += vz
    point[ACCELERATION] += uy * rz - uz * ry + wy * vz - wz * vy
    point[ACCELERATION + 1] += uz * rx - ux * rz + wz * vx - wx * vz
    point[ACCELERATION + 2] += ux * ry - uy * rx + wx * vy - wy * vx


@njit(**INNER)
def _norm(body: Array, column: int) -> float:
    """Return the length of the vector that begins at a column."""
    return length(body[column], body[column + 1], body[column + 2])


@njit(**INNER)
def _root_distance(body: Array, root: Array) -> float:
    """Return the distance of the centres of a body and the root at s = 0."""
    return length(
        body[POSITION] - root[POSITION],
        body[POSITION + 1] - root[POSITION + 1],
        body[POSITION + 2] - root[POSITION + 2],
    )


@njit(**INNER)
def rotation_jerk_bound(body: Array) -> float:
    """Return the bound B of |r'''| for a vector r of length 1 fixed in a body: lemma 2."""
    w = body[ANGULAR_SPEED_BOUND]
    return body[ANGULAR_JERK_BOUND] + 3.0 * w * body[ANGULAR_ACCELERATION_BOUND] + w * w * w


@njit(**KERNEL)
def rod_body(
    last: Array, place: Array, rotation: Array, half: float, turned: Array, body: Array
) -> None:
    """Write the body of a module that is rigidly joined to the module ``last``: lemma 4.

    Args:
        last: (BODY_COLUMNS,) the module that it moves with.
        place, rotation: (3,), (3, 3) its pose in the frame of ``last``.
        half: h.
        turned: (3, 3) scratch.
        body: (BODY_COLUMNS,) written.
    """
    frame = last[ROTATION:VELOCITY].reshape((3, 3))
    multiply(frame, rotation, turned)
    copy_vector(last, body)
    copy_matrix(turned, body[ROTATION:VELOCITY].reshape((3, 3)))
    rx, ry, rz = _rotate(frame, place)
    _shift(last, rx, ry, rz, body)
    lever = length(rx, ry, rz)
    body[JERK_BOUND] += lever * rotation_jerk_bound(last)
    body[DISPLACEMENT_BOUND] += lever * min(2.0, half * last[ANGULAR_SPEED_BOUND])


@njit(**INNER)
def _joint_bounds(body: Array, root: Array, arm: float, half: float) -> JointBounds:
    """Return the bounds for a joint whose centre is fixed in a body, ``arm`` from its centre."""
    w, u, jerk = (
        body[ANGULAR_SPEED_BOUND],
        body[ANGULAR_ACCELERATION_BOUND],
        body[JERK_BOUND],
    )
    speed = _norm(body, VELOCITY)
    acceleration = _norm(body, ACCELERATION)
    distance = _root_distance(body, root)
    distance += body[DISPLACEMENT_BOUND] + arm
    fast = speed + half * (acceleration + 0.5 * half * jerk) + arm * w
    acceleration += half * jerk + arm * (u + w * w)
    return JointBounds(distance, fast, acceleration)


@njit(**INNER)
def _pass_hinge(
    body: Array,
    axis: tuple[float, float, float],
    rate: float,
    half: float,
    centre: JointBounds,
    sums: LeverSums,
) -> LeverSums:
    """Add the turn of a hinge to ω, ω' and their bounds: lemmas 1 and 2; return the new sums.

    Args:
        body: (BODY_COLUMNS,) has the turning of the body before the hinge; receives that behind it.
        axis: n, a unit vector in the root's frame.
        rate: q̇, outwards from the root.
        half: h.
        centre: Bounds for the joint's centre.
        sums: Of the hinges before this one.
    """
    x, y, z = axis
    sx, sy, sz = body[ANGULAR_VELOCITY], body[ANGULAR_VELOCITY + 1], body[ANGULAR_VELOCITY + 2]
    body[ANGULAR_ACCELERATION] += rate * (sy * z - sz * y)
    body[ANGULAR_ACCELERATION + 1] += rate * (sz * x - sx * z)
    body[ANGULAR_ACCELERATION + 2] += rate * (sx * y - sy * x)
    body[ANGULAR_VELOCITY] += rate * x
    body[ANGULAR_VELOCITY + 1] += rate * y
    body[ANGULAR_VELOCITY + 2] += rate * z
    size = abs(rate)
    w, u = body[ANGULAR_SPEED_BOUND], body[ANGULAR_ACCELERATION_BOUND]  # |n'| ≤ w
    bent = size * (u + w * w)  # |q̇| |n''|
    sums = LeverSums(
        sums.rate + size,
        sums.axis_speed + size * w,
        sums.axis_acceleration + bent,
        sums.axis_speed_times_speed + size * w * centre.speed,
        sums.axis_acceleration_times_distance + bent * centre.distance,
        sums.acceleration + size * centre.acceleration,
    )
    jerk = body[ANGULAR_JERK_BOUND] + bent
    u = _norm(body, ANGULAR_ACCELERATION)
    w = _norm(body, ANGULAR_VELOCITY)
    body[ANGULAR_JERK_BOUND] = jerk
    body[ANGULAR_ACCELERATION_BOUND] = min(u + half * jerk, 0.5 * sums.rate * sums.rate)
    body[ANGULAR_SPEED_BOUND] = min(w + half * (u + 0.5 * half * jerk), sums.rate)
    return sums


@njit(**INNER)
def _bound_centre(
    body: Array, root: Array, jerk: float, half: float, sums: LeverSums, reach: float
) -> None:
    """Write the bounds of jerk and displacement of a body's centre: lemmas 3 and 4.

    Args:
        body: (BODY_COLUMNS,) with its motion at s = 0.
        root: (BODY_COLUMNS,) the root.
        jerk: Bound of |p'''| link by link.
        half: h.
        sums: Of the hinges between the root and the body.
        reach: Length of the chain between them.
    """
    speed = _norm(body, VELOCITY)
    acceleration = _norm(body, ACCELERATION)
    # J ≤ L + λ J of lemma 3; this is 1 − λ.
    denominator = 1.0 - half * (
        sums.rate + half * (sums.axis_speed + half * sums.axis_acceleration / 6.0)
    )
    if denominator > 0.0:
        distance = _root_distance(body, root)
        distance += half * (speed + 0.5 * half * acceleration)
        lever = (
            sums.axis_acceleration * distance
            + sums.axis_acceleration_times_distance
            + sums.rate * acceleration
            + sums.acceleration
        )
        lever += 2.0 * (
            sums.axis_speed * (speed + half * acceleration) + sums.axis_speed_times_speed
        )
        jerk = min(jerk, lever / denominator)
    body[JERK_BOUND] = jerk
    body[DISPLACEMENT_BOUND] = min(
        half * (speed + half * (0.5 * acceleration + half * jerk / 6.0)),
        half * sums.rate * reach,
    )


@njit(**INNER)
def _move_outwards(
    angles: Array,
    rates: Array,
    half: float,
    joint: Joint,
    root: int,
    step: int,
    bodies: Array,
) -> None:
    """Write the bodies from the root to one end; ``step`` is 1 or −1."""
    near, far = (joint.anchor, joint.offset) if step > 0 else (joint.offset, joint.anchor)
    near_arm, far_arm = length(near[0], near[1], near[2]), length(far[0], far[1], far[2])
    hinges = joint.axes.shape[0]
    frame = np.empty((3, 3))
    hinge = np.empty((3, 3))
    work = np.empty((3, 3))
    sums = LeverSums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    body = root
    last = bodies.shape[0] - 1 if step > 0 else 0
    while body != last:
        next_body = body + step
        link = min(body, next_body) - joint.rigid_links
        a, b = bodies[body], bodies[next_body]
        copy_vector(a, b)
        copy_matrix(a[ROTATION:VELOCITY].reshape((3, 3)), frame)
        x, y, z = _rotate(frame, near)
        _shift(a, step * x, step * y, step * z, b)  # to the centre of the joint
        if step < 0:
            multiply(frame, joint.turn.T, work)
            copy_matrix(work, frame)
        if link >= 0:
            centre = _joint_bounds(a, bodies[root], near_arm, half)
            for at in range(hinges):
                k = at if step > 0 else hinges - 1 - at
                rate = float(rates[link * hinges + k])
                angle = float(angles[link * hinges + k])
                if rate != 0.0:
                    axis = _rotate(frame, joint.axes[k])
                    sums = _pass_hinge(b, axis, rate * step, half, centre, sums)
                if angle != 0.0:
                    axis_rotation(joint.axes[k], angle * step, hinge)
                    multiply(frame, hinge, work)
                    copy_matrix(work, frame)
        if step > 0:
            multiply(frame, joint.turn, work)
            copy_matrix(work, frame)
        copy_matrix(frame, b[ROTATION:VELOCITY].reshape((3, 3)))
        x, y, z = _rotate(frame, far)
        _shift(b, step * x, step * y, step * z, b)  # to its own centre
        jerk = a[JERK_BOUND] + near_arm * rotation_jerk_bound(a)
        jerk += far_arm * rotation_jerk_bound(b)
        _bound_centre(
            b, bodies[root], jerk, half, sums, abs(next_body - root) * (near_arm + far_arm)
        )
        b[RATE_SUM] = bodies[root, RATE_SUM] + step * sums.rate
        body = next_body


@njit(**KERNEL)
def move_bodies(
    angles: Array,
    rates: Array,
    half: float,
    joint: Joint,
    root: int,
    bodies: Array,
) -> None:
    """Write all bodies of a stretch of a chain: lemmas 1 to 4.

    Args:
        angles, rates: q at s = 0 and q̇, for the joints of the stretch.
        half: h.
        joint: The module's joint; its rigid links are those at the start of the stretch.
        root: The body that is held still; its pose is given.
        bodies: (m, BODY_COLUMNS) written.
    """
    bodies[root, VELOCITY:] = 0.0
    _move_outwards(angles, rates, half, joint, root, ZERO + 1, bodies)
    _move_outwards(angles, rates, half, joint, root, ZERO - 1, bodies)
