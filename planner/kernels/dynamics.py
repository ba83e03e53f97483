"""Inverse dynamics of a chain that floats freely, compiled: linear in its modules."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.kinematics import (
    Matrix,
    axis_rotation,
    copy_matrix,
    multiply,
    product,
    rodrigues,
)
from planner.kernels.module import Joint

Array = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]


@njit(**INNER)
def joint_axes(rotation: Array, axes: Array, angles: Array, out: Array) -> None:
    """Writes the (K, 3) hinge axes of one joint in the world, from the module before it."""
    frame = rotation.copy()
    hinge = np.empty((3, 3))
    work = np.empty((3, 3))
    for k in range(axes.shape[0]):
        for r in range(3):
            out[k, r] = 0.0
            for c in range(3):
                out[k, r] += frame[r, c] * axes[k, c]
        axis_rotation(axes[k], angles[k], hinge)
        multiply(frame, hinge, work)
        copy_matrix(work, frame)


@njit(**INNER)
def _cross(a: Vector, b: Vector) -> Vector:
    """A × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def _turned(rotation: Matrix, v: Array) -> Vector:
    """R v."""
    return (
        rotation[0] * v[0] + rotation[1] * v[1] + rotation[2] * v[2],
        rotation[3] * v[0] + rotation[4] * v[1] + rotation[5] * v[2],
        rotation[6] * v[0] + rotation[7] * v[1] + rotation[8] * v[2],
    )


@njit(**INNER)
def _inertia_of(
    rotation: Matrix, inertia: Array
) -> tuple[float, float, float, float, float, float]:
    """R diag(inertia) Rᵀ: its entries xx, yy, zz, xy, xz and yz."""
    x, y, z = inertia[0], inertia[1], inertia[2]
    a, b, c, d, e, f, g, h, i = rotation
    return (
        a * a * x + b * b * y + c * c * z,
        d * d * x + e * e * y + f * f * z,
        g * g * x + h * h * y + i * i * z,
        a * d * x + b * e * y + c * f * z,
        a * g * x + b * h * y + c * i * z,
        d * g * x + e * h * y + f * i * z,
    )


@njit(**INNER)
def _symmetric(m: Array, v: Vector) -> Vector:
    """M v for the entries xx, yy, zz, xy, xz and yz of M."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[3] * v[0] + m[1] * v[1] + m[5] * v[2],
        m[4] * v[0] + m[5] * v[1] + m[2] * v[2],
    )


@njit(**INNER)
def _solved(m: Array, v: Vector) -> Vector:
    """M⁻¹ v for the entries xx, yy, zz, xy, xz and yz of M; NaN where there is none."""
    a = m[1] * m[2] - m[5] * m[5]
    b = m[4] * m[5] - m[3] * m[2]
    c = m[3] * m[5] - m[4] * m[1]
    whole = m[0] * a + m[3] * b + m[4] * c
    inverse = 1.0 / whole if whole != 0.0 else np.nan
    d = m[0] * m[2] - m[4] * m[4]
    e = m[3] * m[4] - m[0] * m[5]
    f = m[0] * m[1] - m[3] * m[3]
    return (
        inverse * (a * v[0] + b * v[1] + c * v[2]),
        inverse * (b * v[0] + d * v[1] + e * v[2]),
        inverse * (c * v[0] + e * v[1] + f * v[2]),
    )


@njit(**INNER)
def _placed(
    angles: Array,
    rates: Array,
    joint: Joint,
    inertia: Array,
    positions: Array,
    pivots: Array,
    axes: Array,
    inertias: Array,
    velocities: Array,
    spins: Array,
) -> None:
    """Writes a configuration and its velocities, module 0 upright and at rest at the origin.

    Args:
        angles, rates: (J,) of the hinges.
        joint, inertia: Of the module.
        positions: (n, 3) written: centres.
        pivots: (n, 3) written: where the joint to the next module is.
        axes: (n, K, 3) written: axes of the joint to the next module.
        inertias: (n, 6) written: as ``_inertia_of`` gives them.
        velocities, spins: (n, 3) written.
    """
    n, hinges = positions.shape[0], joint.axes.shape[0]
    turn = joint.turn
    fixed = (
        turn[0, 0], turn[0, 1], turn[0, 2],
        turn[1, 0], turn[1, 1], turn[1, 2],
        turn[2, 0], turn[2, 1], turn[2, 2],
    )  # fmt: skip
    rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    x, y, z = 0.0, 0.0, 0.0
    u, v, w = 0.0, 0.0, 0.0
    p, q, r = 0.0, 0.0, 0.0
    for i in range(n):
        positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = u, v, w
        spins[i, 0], spins[i, 1], spins[i, 2] = p, q, r
        own = _inertia_of(rotation, inertia)
        for k in range(6):
            inertias[i, k] = own[k]
        if i + 1 == n:
            return
        arm = _turned(rotation, joint.anchor)
        moved = _cross((p, q, r), arm)
        u, v, w = u + moved[0], v + moved[1], w + moved[2]
        x, y, z = x + arm[0], y + arm[1], z + arm[2]
        pivots[i, 0], pivots[i, 1], pivots[i, 2] = x, y, z
        j = (i - joint.rigid_links) * hinges
        if j >= 0:
            for k in range(hinges):
                axis = _turned(rotation, joint.axes[k])
                axes[i, k, 0], axes[i, k, 1], axes[i, k, 2] = axis
                rate = rates[j + k]
                p, q, r = p + rate * axis[0], q + rate * axis[1], r + rate * axis[2]
                rotation = product(rotation, rodrigues(joint.axes[k], float(angles[j + k])))
        rotation = product(rotation, fixed)
        arm = _turned(rotation, joint.offset)
        moved = _cross((p, q, r), arm)
        u, v, w = u + moved[0], v + moved[1], w + moved[2]
        x, y, z = x + arm[0], y + arm[1], z + arm[2]


@njit(**INNER)
def _accelerated(
    rates: Array,
    accelerations: Array,
    rigid_links: int,
    positions: Array,
    pivots: Array,
    axes: Array,
    spins: Array,
    moving: Array,
    turning: Array,
) -> None:
    """Writes (n, 3) linear and angular accelerations of all modules, those of module 0 being zero.

    The other arguments are as ``_placed`` writes them.
    """
    n, hinges = positions.shape[0], axes.shape[1]
    turn = (0.0, 0.0, 0.0)
    move = (0.0, 0.0, 0.0)
    for i in range(n):
        moving[i, 0], moving[i, 1], moving[i, 2] = move
        turning[i, 0], turning[i, 1], turning[i, 2] = turn
        if i + 1 == n:
            return
        spin = (spins[i, 0], spins[i, 1], spins[i, 2])
        arm = (
            pivots[i, 0] - positions[i, 0],
            pivots[i, 1] - positions[i, 1],
            pivots[i, 2] - positions[i, 2],
        )
        move = _carried(move, turn, spin, arm)
        j = (i - rigid_links) * hinges
        if j >= 0:
            for k in range(hinges):
                axis = (axes[i, k, 0], axes[i, k, 1], axes[i, k, 2])
                rate, change = rates[j + k], accelerations[j + k]
                side = _cross(spin, axis)
                turn = (
                    turn[0] + axis[0] * change + side[0] * rate,
                    turn[1] + axis[1] * change + side[1] * rate,
                    turn[2] + axis[2] * change + side[2] * rate,
                )
                spin = (
                    spin[0] + axis[0] * rate,
                    spin[1] + axis[1] * rate,
                    spin[2] + axis[2] * rate,
                )
        arm = (
            positions[i + 1, 0] - pivots[i, 0],
            positions[i + 1, 1] - pivots[i, 1],
            positions[i + 1, 2] - pivots[i, 2],
        )
        move = _carried(move, turn, spin, arm)


@njit(**INNER)
def _carried(move: Vector, turn: Vector, spin: Vector, arm: Vector) -> Vector:
    """The acceleration at the end of an arm: a + α × arm + ω × (ω × arm)."""
    a = _cross(turn, arm)
    b = _cross(spin, _cross(spin, arm))
    return move[0] + a[0] + b[0], move[1] + a[1] + b[1], move[2] + a[2] + b[2]


@njit(**INNER)
def _balanced(arms: Array, linear: Array, angular: Array, moments: Array, whole: Array) -> None:
    """Adds the motion of one rigid body to all modules, so that no momentum is left of the chain.

    Given accelerations and the torques that modules need about their centres, that its momentum
    does not change.

    Args:
        arms: (n, 3) from the centre of mass.
        linear, angular: (n, 3) changed.
        moments: (n, 3) about the modules' centres.
        whole: (6,) inertia of the whole chain about its centre of mass.
    """
    n = arms.shape[0]
    a, b, c = 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        push = (linear[i, 0], linear[i, 1], linear[i, 2])
        side = _cross((arms[i, 0], arms[i, 1], arms[i, 2]), push)
        a, b, c = a + push[0], b + push[1], c + push[2]
        x, y, z = (
            x + side[0] + moments[i, 0],
            y + side[1] + moments[i, 1],
            z + side[2] + moments[i, 2],
        )
    turn = _solved(whole, (-x, -y, -z))
    for i in range(n):
        side = _cross(turn, (arms[i, 0], arms[i, 1], arms[i, 2]))
        linear[i, 0] += side[0] - a / n
        linear[i, 1] += side[1] - b / n
        linear[i, 2] += side[2] - c / n
        angular[i, 0] += turn[0]
        angular[i, 1] += turn[1]
        angular[i, 2] += turn[2]


@njit(**INNER)
def _moments(inertias: Array, spins: Array, turning: Array, out: Array) -> None:
    """Writes (n, 3) the torques that modules need to turn about their centres: I α + ω × I ω."""
    for i in range(out.shape[0]):
        spin = (spins[i, 0], spins[i, 1], spins[i, 2])
        own = _symmetric(inertias[i], (turning[i, 0], turning[i, 1], turning[i, 2]))
        round_ = _cross(spin, _symmetric(inertias[i], spin))
        out[i, 0] = own[0] + round_[0]
        out[i, 1] = own[1] + round_[1]
        out[i, 2] = own[2] + round_[2]


@njit(**KERNEL, nogil=True)
def many_floating_torques(
    angles: Array,
    rates: Array,
    accelerations: Array,
    joint: Joint,
    inertia: Array,
    out: Array,
) -> None:
    """Writes the (F, J) hinge torques of motions, the chain floating freely and without momentum.

    Newton and Euler: the accelerations of all modules are found along the chain; the torque of a
    hinge is what the modules beyond it need about its axis (Featherstone: Rigid Body Dynamics
    Algorithms, 2008, chapter 5). The velocity and the acceleration of the whole are those for which
    momentum stays zero.

    Args:
        angles, rates, accelerations: (F, J) of the hinges.
        joint, inertia: Of the module; its mass is 1.
        out: (F, J) written, in units of module mass · pitch² / s²; NaN where the motion is none.
    """
    rigid_links = joint.rigid_links
    frames, joints = angles.shape
    hinges = joint.axes.shape[0]
    n = joints // hinges + 1 + rigid_links
    positions, pivots = np.empty((n, 3)), np.empty((n, 3))
    velocities, spins = np.empty((n, 3)), np.empty((n, 3))
    moving, turning = np.empty((n, 3)), np.empty((n, 3))
    arms, moments = np.empty((n, 3)), np.empty((n, 3))
    inertias, axes = np.empty((n, 6)), np.zeros((n, hinges, 3))
    whole, still = np.empty(6), np.zeros((n, 3))
    for f in range(frames):
        _placed(
            angles[f],
            rates[f],
            joint,
            inertia,
            positions,
            pivots,
            axes,
            inertias,
            velocities,
            spins,
        )
        for r in range(3):
            centre = 0.0
            for i in range(n):
                centre += positions[i, r]
            for i in range(n):
                arms[i, r] = positions[i, r] - centre / n
        whole[:] = 0.0
        for i in range(n):
            x, y, z = arms[i, 0], arms[i, 1], arms[i, 2]
            whole[0] += y * y + z * z + inertias[i, 0]
            whole[1] += x * x + z * z + inertias[i, 1]
            whole[2] += x * x + y * y + inertias[i, 2]
            whole[3] += inertias[i, 3] - x * y
            whole[4] += inertias[i, 4] - x * z
            whole[5] += inertias[i, 5] - y * z
        _moments(inertias, still, spins, moments)
        _balanced(arms, velocities, spins, moments, whole)
        _accelerated(
            rates[f],
            accelerations[f],
            rigid_links,
            positions,
            pivots,
            axes,
            spins,
            moving,
            turning,
        )
        _moments(inertias, spins, turning, moments)
        _balanced(arms, moving, turning, moments, whole)
        _moments(inertias, spins, turning, moments)
        # About the origin: what all modules beyond a joint need.
        force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(n - 1, rigid_links, -1):
            push = (moving[i, 0], moving[i, 1], moving[i, 2])
            side = _cross((positions[i, 0], positions[i, 1], positions[i, 2]), push)
            force = (force[0] + push[0], force[1] + push[1], force[2] + push[2])
            moment = (
                moment[0] + side[0] + moments[i, 0],
                moment[1] + side[1] + moments[i, 1],
                moment[2] + side[2] + moments[i, 2],
            )
            side = _cross((pivots[i - 1, 0], pivots[i - 1, 1], pivots[i - 1, 2]), force)
            j = (i - 1 - rigid_links) * hinges
            for k in range(hinges):
                out[f, j + k] = (
                    axes[i - 1, k, 0] * (moment[0] - side[0])
                    + axes[i - 1, k, 1] * (moment[1] - side[1])
                    + axes[i - 1, k, 2] * (moment[2] - side[2])
                )
