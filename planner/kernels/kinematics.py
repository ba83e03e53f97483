"""Forward kinematics of one configuration, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.module import Joint

Array = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
"""Components of a (3,) vector; a tuple needs no allocation."""
Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""Elements of a (3, 3) matrix, row by row; a tuple needs no allocation."""


@njit(**INNER)
def vector(a: Array) -> Vector:
    """Return the components of a (3,) array."""
    return a[0], a[1], a[2]


@njit(**INNER)
def matrix(a: Array) -> Matrix:
    """Return the elements of a (3, 3) array, row by row."""
    return (
        a[0, 0], a[0, 1], a[0, 2],
        a[1, 0], a[1, 1], a[1, 2],
        a[2, 0], a[2, 1], a[2, 2],
    )  # fmt: skip


@njit(**INNER)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def rotate(rotation: Matrix, v: Array) -> Vector:
    """Return R v."""
    return (
        rotation[0] * v[0] + rotation[1] * v[1] + rotation[2] * v[2],
        rotation[3] * v[0] + rotation[4] * v[1] + rotation[5] * v[2],
        rotation[6] * v[0] + rotation[7] * v[1] + rotation[8] * v[2],
    )


@njit(**INNER)
def rodrigues(axis: Array, angle: float) -> Matrix:
    """Return the rotation about a unit axis: Rodrigues' formula."""
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
    """Return the product of two matrices."""
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
    """Write the rotation about a unit axis into ``out`` (3, 3)."""
    write_matrix(rodrigues(axis, angle), out)


@njit(**INNER)
def multiply(a: Array, b: Array, out: Array) -> None:
    """Write the product of two (3, 3) matrices into ``out``, which is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


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
def _step_rotation(axes: Array, fixed: Matrix, q: Array) -> Matrix:
    """Return the rotation from one module's frame to the next one's.

    Args:
        axes: (K, 3) hinge axes of the joint, outermost first.
        fixed: Fixed rotation behind the hinges.
        q: (K,) angles of the hinges; (0,) for a rigid link.
    """
    step = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for k in range(q.shape[0]):
        step = product(step, rodrigues(axes[k], float(q[k])))
    return product(step, fixed)


@njit(**INNER)
def write_matrix(m: Matrix, out: Array) -> None:
    """Write the elements of a matrix into ``out`` (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = m[0], m[1], m[2]
    out[1, 0], out[1, 1], out[1, 2] = m[3], m[4], m[5]
    out[2, 0], out[2, 1], out[2, 2] = m[6], m[7], m[8]


@njit(**KERNEL)
def chain_poses(
    q: Array,
    joint: Joint,
    root: int,
    root_position: Array,
    root_rotation: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Write the poses of all modules of one configuration, outward from the root both ways.

    Args:
        q: (J,) hinge angles, in rad.
        joint: The module's joint.
        root: Index of the module whose pose is given.
        root_position: (3,) its centre.
        root_rotation: (3, 3) its orientation.
        positions: (n, 3) written: the centres.
        rotations: (n, 3, 3) written: the orientations.
    """
    rigid_links, anchor, axes, turn, offset = joint
    hinges, fixed = axes.shape[0], matrix(turn)
    copy_vector(root_position, positions[root])
    copy_matrix(root_rotation, rotations[root])
    rotation = matrix(root_rotation)
    for i in range(root, positions.shape[0] - 1):
        j = (i - rigid_links) * hinges
        step = _step_rotation(axes, fixed, q[max(j, 0) : max(j + hinges, 0)])
        rotation = product(rotation, step)
        write_matrix(rotation, rotations[i + 1])
        for r in range(3):
            total = positions[i, r]
            for c in range(3):
                total += rotations[i, r, c] * anchor[c] + rotations[i + 1, r, c] * offset[c]
            positions[i + 1, r] = total
    rotation = matrix(root_rotation)
    for i in range(root - 1, -1, -1):
        j = (i - rigid_links) * hinges
        step = _step_rotation(axes, fixed, q[max(j, 0) : max(j + hinges, 0)])
        a, b, c, d, e, f, g, h, k = step
        rotation = product(rotation, (a, d, g, b, e, h, c, f, k))
        write_matrix(rotation, rotations[i])
        for r in range(3):
            total = positions[i + 1, r]
            for s in range(3):
                total -= rotations[i, r, s] * anchor[s] + rotations[i + 1, r, s] * offset[s]
            positions[i, r] = total


@njit(**KERNEL, nogil=True)
def many_chain_poses(
    q: Array,
    joint: Joint,
    root: int,
    root_positions: Array,
    root_rotations: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Write the poses of F configurations, see ``chain_poses``.

    Args:
        q: (F, J) hinge angles, in rad.
        joint: The module's joint.
        root: Index of the module whose poses are given.
        root_positions: (F, 3) its centres.
        root_rotations: (F, 3, 3) its orientations.
        positions: (F, n, 3) written: the centres.
        rotations: (F, n, 3, 3) written: the orientations.
    """
    for f in range(q.shape[0]):
        chain_poses(
            q[f],
            joint,
            root,
            root_positions[f],
            root_rotations[f],
            positions[f],
            rotations[f],
        )


@njit(**INNER)
def poses_at_origin(q: Array, joint: Joint, root: int, positions: Array, rotations: Array) -> None:
    """Write the poses for a root at the origin with identity orientation, see ``chain_poses``."""
    chain_poses(q, joint, root, np.zeros(3), np.eye(3), positions, rotations)
