"""Inverse dynamics of a chain that floats freely, compiled: linear in its modules."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import ZERO
from planner.kernels.kinematics import axis_rotation, multiply, poses_from_rest
from planner.kernels.module import Joint
from planner.kernels.velocities import chain_velocities, cross

Array = NDArray[np.float64]


@njit(cache=True)
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
        frame[:, :] = work


@njit(cache=True)
def _turned_inertia(rotation: Array, inertia: Array, vector: Array, out: Array) -> None:
    """Writes R diag(inertia) Rᵀ · vector."""
    for r in range(3):
        out[r] = 0.0
    for c in range(3):
        local = 0.0
        for r in range(3):
            local += rotation[r, c] * vector[r]
        for r in range(3):
            out[r] += rotation[r, c] * inertia[c] * local


@njit(cache=True)
def _add_arm(
    i: int,
    arm: Array,
    spins: Array,
    turning: Array,
    work: Array,
    work_2: Array,
    out: Array,
) -> None:
    """Adds α × arm + ω × (ω × arm) of module i to ``out``."""
    cross(turning[i], arm, work)
    for r in range(3):
        out[r] += work[r]
    cross(spins[i], arm, work)
    cross(spins[i], work, work_2)
    for r in range(3):
        out[r] += work_2[r]


@njit(cache=True)
def _accelerations(
    angles: Array,
    rates: Array,
    accelerations: Array,
    joint: Joint,
    positions: Array,
    rotations: Array,
    spins: Array,
    moving: Array,
    turning: Array,
) -> None:
    """Writes linear and angular accelerations of all modules, those of module 0 being zero."""
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    n = positions.shape[0]
    hinges = axes.shape[0]
    world = np.empty((hinges, 3))
    arm = np.empty(3)
    pivot = np.empty(3)
    work = np.empty(3)
    work_2 = np.empty(3)
    spin = np.empty(3)
    moving[0] = 0.0
    turning[0] = 0.0
    for i in range(n - 1):
        turning[i + 1] = turning[i]
        j = (i - rigid_links) * hinges
        if j >= 0:
            joint_axes(rotations[i], axes, angles[j : j + hinges], world)
            spin[:] = spins[i]
            for k in range(hinges):
                cross(spin, world[k], work)
                for r in range(3):
                    turning[i + 1, r] += world[k, r] * accelerations[j + k] + work[r] * rates[j + k]
                    spin[r] += world[k, r] * rates[j + k]
        for r in range(3):
            arm[r] = 0.0
            for c in range(3):
                arm[r] += rotations[i, r, c] * anchor[c]
            pivot[r] = positions[i, r] + arm[r]
        moving[i + 1] = moving[i]
        _add_arm(i, arm, spins, turning, work, work_2, moving[i + 1])
        for r in range(3):
            arm[r] = positions[i + 1, r] - pivot[r]
        _add_arm(i + 1, arm, spins, turning, work, work_2, moving[i + 1])


@njit(cache=True)
def _rigid(
    arms: Array,
    rotations: Array,
    inertia: Array,
    linear: Array,
    angular: Array,
    gyroscopic: Array,
    whole: Array,
) -> None:
    """Adds the motion of one rigid body to all modules, so that no momentum is left of the chain.

    Given accelerations and the gyroscopic terms, that its momentum does not change.
    """
    n = arms.shape[0]
    total = np.zeros(3)
    moment = np.zeros(3)
    work = np.empty(3)
    for i in range(n):
        cross(arms[i], linear[i], work)
        for r in range(3):
            total[r] += linear[i, r]
            moment[r] += work[r] + gyroscopic[i, r]
        _turned_inertia(rotations[i], inertia, angular[i], work)
        for r in range(3):
            moment[r] += work[r]
    if not np.isfinite(moment).all():
        linear[:] = np.nan
        return
    turn: Array = np.linalg.solve(whole, -moment)  # pyright: ignore[reportAssignmentType]
    for i in range(n):
        cross(turn, arms[i], work)
        for r in range(3):
            linear[i, r] += work[r] - total[r] / n
            angular[i, r] += turn[r]


@njit(cache=True, nogil=True)
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
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    frames, joints = angles.shape
    hinges = axes.shape[0]
    n = joints // hinges + 1 + rigid_links
    positions = np.empty((n, 3))
    rotations = np.empty((n, 3, 3))
    velocities = np.empty((n, 3))
    spins = np.empty((n, 3))
    moving = np.empty((n, 3))
    turning = np.empty((n, 3))
    gyroscopic = np.zeros((n, 3))
    arms = np.empty((n, 3))
    origin = np.zeros(3)
    whole = np.empty((3, 3))
    world = np.empty((hinges, 3))
    work = np.empty(3)
    work_2 = np.empty(3)
    force = np.empty(3)
    moment = np.empty(3)
    pivot = np.empty(3)
    for f in range(frames):
        poses_from_rest(angles[f], joint, ZERO, positions, rotations)
        chain_velocities(
            angles[f],
            rates[f],
            joint,
            ZERO,
            origin,
            origin,
            positions,
            rotations,
            velocities,
            spins,
        )
        for r in range(3):
            centre = 0.0
            for i in range(n):
                centre += positions[i, r]
            for i in range(n):
                arms[i, r] = positions[i, r] - centre / n
        whole[:, :] = 0.0
        for i in range(n):
            square = arms[i, 0] ** 2 + arms[i, 1] ** 2 + arms[i, 2] ** 2
            for r in range(3):
                whole[r, r] += square
                for c in range(3):
                    whole[r, c] -= arms[i, r] * arms[i, c]
                    for k in range(3):
                        whole[r, c] += rotations[i, r, k] * inertia[k] * rotations[i, c, k]
        gyroscopic[:, :] = 0.0
        _rigid(arms, rotations, inertia, velocities, spins, gyroscopic, whole)
        _accelerations(
            angles[f],
            rates[f],
            accelerations[f],
            joint,
            positions,
            rotations,
            spins,
            moving,
            turning,
        )
        for i in range(n):
            _turned_inertia(rotations[i], inertia, spins[i], work)
            cross(spins[i], work, gyroscopic[i])
        _rigid(arms, rotations, inertia, moving, turning, gyroscopic, whole)
        force[:] = 0.0
        moment[:] = 0.0
        for i in range(n - 1, rigid_links, -1):
            cross(positions[i], moving[i], work)
            _turned_inertia(rotations[i], inertia, turning[i], work_2)
            for r in range(3):
                force[r] += moving[i, r]
                moment[r] += work[r] + work_2[r] + gyroscopic[i, r]
            j = (i - 1 - rigid_links) * hinges
            joint_axes(rotations[i - 1], axes, angles[f, j : j + hinges], world)
            for r in range(3):
                pivot[r] = positions[i - 1, r]
                for c in range(3):
                    pivot[r] += rotations[i - 1, r, c] * anchor[c]
            cross(pivot, force, work)
            for k in range(hinges):
                torque = 0.0
                for r in range(3):
                    torque += world[k, r] * (moment[r] - work[r])
                out[f, j + k] = torque
