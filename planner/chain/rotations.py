"""Rotations: quaternions (w, x, y, z), matrices, and the rotation that lays points over others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def matrix_from_wxyz(wxyz: Array) -> Array:
    """(..., 4) quaternions, of any length but 0, to (..., 3, 3) matrices."""
    from planner.kernels.rotations import matrices  # a compiler: only for who computes

    rows = np.ascontiguousarray(wxyz, dtype=np.float64).reshape(-1, 4)
    rows.setflags(write=False)
    out = np.empty((len(rows), 3, 3))
    matrices(rows, out)
    return out.reshape(*np.shape(wxyz)[:-1], 3, 3)


def wxyz_from_matrix(matrix: Array) -> Array:
    """(..., 3, 3) rotation matrices to (..., 4) unit quaternions with w ≥ 0."""
    from planner.kernels.rotations import quaternions  # as above

    # A copy: a read-only array is another type, for which the kernel would be compiled once more.
    rows = np.array(matrix, dtype=np.float64, order="C").reshape(-1, 3, 3)
    out = np.empty((len(rows), 4))
    quaternions(rows, out)
    return out.reshape(*np.shape(matrix)[:-2], 4)


def aligned_distances(points: Array, target: Array) -> Array:
    """(n,) distances that remain after the best rigid motion of (n, 3) points onto a target.

    Kabsch: A solution for the best rotation to relate two sets of vectors, 1976.
    """
    moved = points - points.mean(axis=0)
    fixed = target - target.mean(axis=0)
    left, _, right = np.linalg.svd(moved.T @ fixed)
    handed = np.sign(np.linalg.det(left @ right))
    rotation = left @ np.diag([1.0, 1.0, handed]) @ right
    return np.linalg.norm(moved @ rotation - fixed, axis=1)


def motion_in_plane(points: Array, target: Array) -> tuple[Array, Array]:
    """The best turn about the vertical, and then shift along the plane, of points onto a target.

    Args:
        points: (F, n, 3).
        target: (F, n, 3).

    Returns:
        (F, 3, 3) rotations and (F, 3) shifts, whose z is 0.
    """
    middles, there = points.mean(axis=1), target.mean(axis=1)
    moved, fixed = points - middles[:, None], target - there[:, None]
    along = (moved * fixed)[..., :2].sum(axis=(1, 2))
    across = (moved[..., 0] * fixed[..., 1] - moved[..., 1] * fixed[..., 0]).sum(axis=1)
    turns = np.arctan2(across, along)
    rotations = np.zeros((len(turns), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(turns)
    rotations[:, 1, 0] = np.sin(turns)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    shifts = there - (rotations @ middles[:, :, None])[..., 0]
    shifts[:, 2] = 0.0
    return rotations, shifts
