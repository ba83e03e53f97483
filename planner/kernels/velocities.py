"""Velocities of all modules from the velocities of the hinges and the root, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.kinematics import copy_vector, product, rodrigues
from planner.kernels.module import Joint

Array = NDArray[np.float64]


@njit(**INNER)
def cross(a: Array, b: Array, out: Array) -> None:
    """Writes the cross product of two (3,) vectors into ``out``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def relative_spin(rotation: Array, axes: Array, angles: Array, rates: Array, out: Array) -> None:
    """Writes the angular velocity that one joint's hinges give the next module, in the world."""
    f = (
        rotation[0, 0],
        rotation[0, 1],
        rotation[0, 2],
        rotation[1, 0],
        rotation[1, 1],
        rotation[1, 2],
        rotation[2, 0],
        rotation[2, 1],
        rotation[2, 2],
    )
    out[:] = 0.0
    for k in range(axes.shape[0]):
        for c in range(3):
            out[0] += f[c] * axes[k, c] * rates[k]
            out[1] += f[3 + c] * axes[k, c] * rates[k]
            out[2] += f[6 + c] * axes[k, c] * rates[k]
        if k + 1 == axes.shape[0]:
            return
        f = product(f, rodrigues(axes[k], angles[k]))


@njit(**KERNEL)
def chain_velocities(
    angles: Array,
    rates: Array,
    joint: Joint,
    root: int,
    root_velocity: Array,
    root_spin: Array,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
) -> None:
    """Writes (n, 3) linear and angular velocities in the world's frame.

    The poses must be those of ``chain_poses`` for the same angles.
    """
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    n = positions.shape[0]
    hinges = axes.shape[0]
    spin = np.zeros(3)
    arm = np.empty(3)
    turn = np.empty(3)
    pivot = np.empty(3)
    copy_vector(root_velocity, velocities[root])
    copy_vector(root_spin, spins[root])
    for step in range(n - 1):
        # From the root to the end, then from the root back; i is the module that holds the joint.
        ahead = step < n - 1 - root
        i = root + step if ahead else n - 2 - step
        known, new, sign = (i, i + 1, 1.0) if ahead else (i + 1, i, -1.0)
        j = (i - rigid_links) * hinges
        if j >= 0:
            relative_spin(rotations[i], axes, angles[j : j + hinges], rates[j : j + hinges], spin)
        else:
            spin[:] = 0.0
        for r in range(3):
            pivot[r] = positions[i, r]
            for c in range(3):
                pivot[r] += rotations[i, r, c] * anchor[c]
        for r in range(3):
            spins[new, r] = spins[known, r] + sign * spin[r]
            arm[r] = pivot[r] - positions[known, r]
        cross(spins[known], arm, turn)
        for r in range(3):
            velocities[new, r] = velocities[known, r] + turn[r]
            arm[r] = positions[new, r] - pivot[r]
        cross(spins[new], arm, turn)
        for r in range(3):
            velocities[new, r] += turn[r]


@njit(**INNER)
def momentum_velocity(
    masses: Array,
    inertia: Array,
    root: int,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
) -> tuple[Array, Array, Array]:
    """How a rigid body of the same shape, momentum and angular momentum would move.

    Args:
        masses: (n,) of the modules.
        inertia: (3,) of a module of mass 1 about its axes.
        root: A module.
        positions, rotations, velocities, spins: (n, 3), (n, 3, 3), (n, 3), (n, 3) in the world.

    Returns:
        (3,) velocity of the root, (3,) spin, and (3,) the centre of mass.
    """
    total = masses.sum()
    centre = np.zeros(3)
    velocity = np.zeros(3)
    for i in range(masses.shape[0]):
        for r in range(3):
            centre[r] += masses[i] / total * positions[i, r]
            velocity[r] += masses[i] / total * velocities[i, r]
    momentum = np.zeros(3)
    whole = np.zeros((3, 3))
    arm = np.empty(3)
    moved = np.empty(3)
    work = np.empty(3)
    for i in range(masses.shape[0]):
        square = 0.0
        for r in range(3):
            arm[r] = positions[i, r] - centre[r]
            moved[r] = velocities[i, r] - velocity[r]
            square += arm[r] * arm[r]
        cross(arm, moved, work)
        for r in range(3):
            momentum[r] += masses[i] * work[r]
            whole[r, r] += masses[i] * square
            for c in range(3):
                own = 0.0
                for k in range(3):
                    own += rotations[i, r, k] * inertia[k] * rotations[i, c, k]
                whole[r, c] += masses[i] * (own - arm[r] * arm[c])
                momentum[r] += masses[i] * own * spins[i, c]
    spin: Array = np.linalg.solve(whole, momentum)  # pyright: ignore[reportAssignmentType]
    for r in range(3):
        arm[r] = positions[root, r] - centre[r]
    cross(spin, arm, work)
    return velocity + work, spin, centre
