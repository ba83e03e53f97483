"""Velocities of all modules from the velocities of the hinges and the root, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.kinematics import (
    Vector,
    copy_vector,
    cross,
    matrix,
    multiply,
    product,
    rodrigues,
    vector,
)
from foldback.planner.kernels.module import ChainModel, Joint, Lumps, ModuleStates

Array = NDArray[np.float64]


@njit(**INNER)
def relative_angular_velocity(rotation: Array, axes: Array, q: Array, qd: Array) -> Vector:
    """Return ω of the next module relative to this one, in the world frame.

    Args:
        rotation: (3, 3) orientation of the module before the joint.
        axes: (K, 3) hinge axes in its frame, outermost first.
        q, qd: (K,) angles and rates of the joint's hinges.
    """
    frame = matrix(rotation)
    x, y, z = 0.0, 0.0, 0.0
    for k in range(axes.shape[0]):
        for c in range(3):
            x += frame[c] * axes[k, c] * qd[k]
            y += frame[3 + c] * axes[k, c] * qd[k]
            z += frame[6 + c] * axes[k, c] * qd[k]
        if k + 1 < axes.shape[0]:
            frame = product(frame, rodrigues(axes[k], q[k]))
    return x, y, z


@njit(**INNER)
def _pivot(position: Array, rotation: Array, anchor: Array) -> Vector:
    """Return the centre of the joint behind a module, in the world frame."""
    x, y, z = position[0], position[1], position[2]
    for c in range(3):
        x += rotation[0, c] * anchor[c]
        y += rotation[1, c] * anchor[c]
        z += rotation[2, c] * anchor[c]
    return x, y, z


@njit(**KERNEL)
def chain_velocities(
    q: Array,
    qd: Array,
    joint: Joint,
    root: int,
    root_velocity: Array,
    root_angular_velocity: Array,
    modules: ModuleStates,
) -> None:
    """Write the velocities of all modules, in the world frame.

    From module to module v' = v + ω × (pivot − p) + ω' × (p' − pivot).

    Args:
        q, qd: (J,) hinge angles and rates.
        joint: The module's joint.
        root: Index of the module whose velocities are given.
        root_velocity: (3,) velocity of its centre in the world frame.
        root_angular_velocity: (3,) ω in the world frame.
        modules: Poses as ``chain_poses`` writes them for ``q``; the velocities are written.
    """
    positions, rotations, velocities, omega = modules
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    n = positions.shape[0]
    hinges = axes.shape[0]
    copy_vector(root_velocity, velocities[root])
    copy_vector(root_angular_velocity, omega[root])
    for step in range(n - 1):
        # From the root to the end, then from the root back; i is the module that holds the joint.
        ahead = step < n - 1 - root
        i = root + step if ahead else n - 2 - step
        source, new, sign = (i, i + 1, 1.0) if ahead else (i + 1, i, -1.0)
        j = (i - rigid_links) * hinges
        relative = (0.0, 0.0, 0.0)
        if j >= 0:
            relative = relative_angular_velocity(
                rotations[i], axes, q[j : j + hinges], qd[j : j + hinges]
            )
        x, y, z = _pivot(positions[i], rotations[i], anchor)
        omega[new, 0] = omega[source, 0] + sign * relative[0]
        omega[new, 1] = omega[source, 1] + sign * relative[1]
        omega[new, 2] = omega[source, 2] + sign * relative[2]
        near = cross(
            vector(omega[source]),
            (x - positions[source, 0], y - positions[source, 1], z - positions[source, 2]),
        )
        far = cross(
            vector(omega[new]),
            (positions[new, 0] - x, positions[new, 1] - y, positions[new, 2] - z),
        )
        for r in range(3):
            velocities[new, r] = velocities[source, r] + near[r] + far[r]


@njit(**INNER)
def write_lump(
    end: int, i: int, lumps: Lumps, modules: ModuleStates, arm: Array, inertia: Array
) -> None:
    """Write a lump's centre of mass relative to its module, and its inertia, in the world frame.

    Args:
        end: 0 for the lump of the first module, 1 for that of the last one.
        i: Index of that module.
        lumps: The lumps.
        modules: Poses of all modules.
        arm: (3,) written: vector from the module's centre to the centre of mass.
        inertia: (3, 3) written: about the centre of mass.
    """
    axes = np.empty((3, 3))
    multiply(modules.rotations[i], lumps.axes[end], axes)
    for r in range(3):
        arm[r] = 0.0
        for k in range(3):
            arm[r] += modules.rotations[i, r, k] * lumps.centres[end, k]
        for c in range(3):
            inertia[r, c] = 0.0
            for k in range(3):
                inertia[r, c] += axes[r, k] * lumps.moments[end, k] * axes[c, k]


@njit(**INNER)
def equivalent_rigid_velocity(
    model: ChainModel, modules: ModuleStates
) -> tuple[Array, Array, Array]:
    """Return the motion of a rigid body of the same shape, momentum and angular momentum.

    Args:
        model: Inertial parameters of the chain.
        modules: Poses and velocities of all modules.

    Returns:
        (3,) velocity of the root, (3,) ω, and (3,) centre of mass, in the world frame.
    """
    positions, rotations, velocities, omega = modules
    n, lumps = positions.shape[0], model.lumps
    masses = np.empty(n + 2)
    centres, motions = np.empty((n + 2, 3)), np.empty((n + 2, 3))
    inertias = np.zeros((n + 2, 3, 3))
    arm = np.empty(3)
    for b in range(n + 2):  # the modules, then both lumps
        i = b if b < n else (b - n) * (n - 1)
        orbital = (0.0, 0.0, 0.0)
        if b < n:
            masses[b] = model.masses[i]
            for r in range(3):
                arm[r] = 0.0
                for c in range(3):
                    for k in range(3):
                        inertias[b, r, c] += (
                            rotations[i, r, k] * (masses[b] * model.inertia[k]) * rotations[i, c, k]
                        )
        else:
            masses[b] = lumps.masses[b - n]
            write_lump(b - n, i, lumps, modules, arm, inertias[b])
            orbital = cross(vector(omega[i]), vector(arm))
        for r in range(3):
            centres[b, r] = positions[i, r] + arm[r]
            motions[b, r] = velocities[i, r] + orbital[r]
    total = masses.sum()
    centre, velocity = np.zeros(3), np.zeros(3)
    for b in range(n + 2):
        for r in range(3):
            centre[r] += masses[b] / total * centres[b, r]
            velocity[r] += masses[b] / total * motions[b, r]
    momentum = np.zeros(3)
    inertia = np.zeros((3, 3))
    relative = np.empty(3)
    for b in range(n + 2):
        i = b if b < n else (b - n) * (n - 1)
        square = 0.0
        for r in range(3):
            arm[r] = centres[b, r] - centre[r]
            relative[r] = motions[b, r] - velocity[r]
            square += arm[r] * arm[r]
        orbital = cross(vector(arm), vector(relative))
        for r in range(3):
            momentum[r] += masses[b] * orbital[r]
            inertia[r, r] += masses[b] * square
            for c in range(3):
                inertia[r, c] += inertias[b, r, c] - masses[b] * arm[r] * arm[c]
                momentum[r] += inertias[b, r, c] * omega[i, c]
    rigid: Array = np.linalg.solve(inertia, momentum)  # pyright: ignore[reportAssignmentType]
    for r in range(3):
        arm[r] = positions[model.root, r] - centre[r]
    turning = cross(vector(rigid), vector(arm))
    for r in range(3):
        velocity[r] += turning[r]
    return velocity, rigid, centre
