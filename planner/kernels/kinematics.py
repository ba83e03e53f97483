"""Forward kinematics of one configuration, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.module import Joint

Array = NDArray[np.float64]
Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""Rows of a (3, 3) matrix one after the other: needs no memory of its own."""


@njit(**INNER)
def rodrigues(axis: Array, angle: float) -> Matrix:
    """The rotation about a unit axis, row by row: Rodrigues' formula."""
    c = np.cos(angle)
    s = np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    return (
        c + x * x * k,
        x * y * k - z * s,
        x * z * k + y * s,
        y * x * k + z * s,
        c + y * y * k,
        y * z * k - x * s,
        z * x * k - y * s,
        z * y * k + x * s,
        c + z * z * k,
    )


@njit(**INNER)
def product(a: Matrix, b: Matrix) -> Matrix:
    """The product of two matrices, row by row."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@njit(**INNER)
def axis_rotation(axis: Array, angle: float, out: Array) -> None:
    """Writes the rotation about a unit axis into ``out`` (3, 3)."""
    h = rodrigues(axis, angle)
    for i in range(3):
        for j in range(3):
            out[i, j] = h[3 * i + j]


@njit(**INNER)
def multiply(a: Array, b: Array, out: Array) -> None:
    """Writes the product of two (3, 3) matrices into ``out``, which is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(**INNER)
def _multiply_by(out: Array, b: Matrix) -> None:
    """Multiplies ``out`` (3, 3) from the right, in place."""
    for i in range(3):
        x, y, z = out[i, 0], out[i, 1], out[i, 2]
        out[i, 0] = x * b[0] + y * b[3] + z * b[6]
        out[i, 1] = x * b[1] + y * b[4] + z * b[7]
        out[i, 2] = x * b[2] + y * b[5] + z * b[8]


@njit(**INNER)
def copy_vector(a: Array, out: Array) -> None:
    """Write the elements of one vector into another one of the same size.

    ``out[:] = a`` compiles a check of both shapes and the text of its error, seconds in all.
    """
    for i in range(out.shape[0]):
        out[i] = a[i]


@njit(**INNER)
def copy_matrix(a: Array, out: Array) -> None:
    """Write the elements of one matrix into another one of the same size; see ``copy_vector``."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = a[i, j]


@njit(**INNER)
def step_rotation(axes: Array, turn: Array, angles: Array, jointed: bool, out: Array) -> None:
    """Writes the rotation from one module's frame to the next one's into ``out`` (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = 1.0 if i == j else 0.0
    if jointed:
        for k in range(axes.shape[0]):
            _multiply_by(out, rodrigues(axes[k], angles[k]))
    _multiply_by(
        out,
        (
            turn[0, 0],
            turn[0, 1],
            turn[0, 2],
            turn[1, 0],
            turn[1, 1],
            turn[1, 2],
            turn[2, 0],
            turn[2, 1],
            turn[2, 2],
        ),
    )


@njit(**KERNEL)
def chain_poses(
    angles: Array,
    joint: Joint,
    root: int,
    root_position: Array,
    root_rotation: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Writes all module poses of one configuration, outward from the root both ways.

    Args:
        angles: (J,) hinge angles in radians.
        joint: The module's joint.
        root: Index of the module whose pose is given.
        root_position: (3,) its centre.
        root_rotation: (3, 3) its orientation.
        positions: (n, 3) written: the centres.
        rotations: (n, 3, 3) written: the orientations.
    """
    rigid_links, anchor, axes, turn, offset = joint
    n = positions.shape[0]
    hinges = axes.shape[0]
    step = np.empty((3, 3))
    copy_vector(root_position, positions[root])
    copy_matrix(root_rotation, rotations[root])
    for i in range(root, n - 1):
        j = (i - rigid_links) * hinges
        step_rotation(axes, turn, angles[max(j, 0) : max(j, 0) + hinges], j >= 0, step)
        multiply(rotations[i], step, rotations[i + 1])
        for r in range(3):
            total = positions[i, r]
            for c in range(3):
                total += rotations[i, r, c] * anchor[c] + rotations[i + 1, r, c] * offset[c]
            positions[i + 1, r] = total
    for i in range(root - 1, -1, -1):
        j = (i - rigid_links) * hinges
        step_rotation(axes, turn, angles[max(j, 0) : max(j, 0) + hinges], j >= 0, step)
        multiply(rotations[i + 1], step.T, rotations[i])
        for r in range(3):
            total = positions[i + 1, r]
            for c in range(3):
                total -= rotations[i, r, c] * anchor[c] + rotations[i + 1, r, c] * offset[c]
            positions[i, r] = total


@njit(**KERNEL, nogil=True)
def many_chain_poses(
    angles: Array,
    joint: Joint,
    root: int,
    root_positions: Array,
    root_rotations: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """``chain_poses`` for (F, J) angles, (F, 3) and (F, 3, 3) roots."""
    for f in range(angles.shape[0]):
        chain_poses(
            angles[f],
            joint,
            root,
            root_positions[f],
            root_rotations[f],
            positions[f],
            rotations[f],
        )


@njit(**INNER)
def poses_from_rest(
    angles: Array, joint: Joint, root: int, positions: Array, rotations: Array
) -> None:
    """``chain_poses`` with the root at the origin, upright."""
    chain_poses(angles, joint, root, np.zeros(3), np.eye(3), positions, rotations)
