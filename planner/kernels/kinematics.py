"""Forward kinematics of one configuration, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def axis_rotation(axis: Array, angle: float, out: Array) -> None:
    """Writes the rotation about a unit axis into ``out`` (3, 3): Rodrigues' formula."""
    c = np.cos(angle)
    s = np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0] = c + x * x * k
    out[0, 1] = x * y * k - z * s
    out[0, 2] = x * z * k + y * s
    out[1, 0] = y * x * k + z * s
    out[1, 1] = c + y * y * k
    out[1, 2] = y * z * k - x * s
    out[2, 0] = z * x * k - y * s
    out[2, 1] = z * y * k + x * s
    out[2, 2] = c + z * z * k


@njit(cache=True)
def multiply(a: Array, b: Array, out: Array) -> None:
    """Writes the product of two (3, 3) matrices into ``out``, which is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def step_rotation(axes: Array, turn: Array, angles: Array, jointed: bool, out: Array) -> None:
    """Writes the rotation from one module's frame to the next one's into ``out`` (3, 3)."""
    work = np.empty((3, 3))
    hinge = np.empty((3, 3))
    out[:, :] = np.eye(3)
    if jointed:
        for k in range(axes.shape[0]):
            axis_rotation(axes[k], angles[k], hinge)
            multiply(out, hinge, work)
            out[:, :] = work
    multiply(out, turn, work)
    out[:, :] = work


@njit(cache=True)
def chain_poses(
    angles: Array,
    rigid_links: int,
    anchor: Array,
    axes: Array,
    turn: Array,
    offset: Array,
    root: int,
    root_position: Array,
    root_rotation: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Writes all module poses of one configuration, outward from the root both ways.

    Args:
        angles: (J,) hinge angles in radians.
        rigid_links: Links at the start that carry no joint.
        anchor, axes, turn, offset: The module's joint, see ``planner.modules.Module``.
        root: Index of the module whose pose is given.
        root_position: (3,) its centre.
        root_rotation: (3, 3) its orientation.
        positions: (n, 3) written: the centres.
        rotations: (n, 3, 3) written: the orientations.
    """
    n = positions.shape[0]
    hinges = axes.shape[0]
    step = np.empty((3, 3))
    positions[root] = root_position
    rotations[root] = root_rotation
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


@njit(cache=True)
def many_chain_poses(
    angles: Array,
    rigid_links: int,
    anchor: Array,
    axes: Array,
    turn: Array,
    offset: Array,
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
            rigid_links,
            anchor,
            axes,
            turn,
            offset,
            root,
            root_positions[f],
            root_rotations[f],
            positions[f],
            rotations[f],
        )
