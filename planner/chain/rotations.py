"""Rotations: quaternions (w, x, y, z), matrices, and the rotation that lays points over others."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array

QUARTER_RAD: Final = np.pi / 2
"""Right angle, rad."""


def matrix_from_wxyz(wxyz: Array) -> Array:
    """Return the (..., 3, 3) matrices of (..., 4) quaternions; NaN where the length is 0."""
    rows = np.asarray(wxyz, dtype=np.float64)
    w, x, y, z = np.moveaxis(rows, -1, 0)
    with np.errstate(invalid="ignore"):
        length = np.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / length, x / length, y / length, z / length
    out = np.empty((*rows.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 2, 1] = 2 * (y * z + w * x)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def wxyz_from_matrix(matrix: Array) -> Array:
    """Return the (..., 4) unit quaternions, w ≥ 0, of (..., 3, 3) rotation matrices.

    Each is a row of the outer product of the quaternion with itself, times four: the row with the
    largest square, which loses the least precision.
    """
    m = np.asarray(matrix, dtype=np.float64)
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    squares = np.stack([1 + trace, *(1 + 2 * m[..., k, k] - trace for k in range(3))], axis=-1)
    a, b, c = (m[..., i, j] - m[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    d, e, f = (m[..., i, j] + m[..., j, i] for i, j in ((1, 0), (0, 2), (2, 1)))
    s0, s1, s2, s3 = np.moveaxis(squares, -1, 0)
    products = np.stack([s0, a, b, c, a, s1, d, e, b, d, s2, f, c, e, f, s3], axis=-1)
    products = products.reshape(*trace.shape, 4, 4)
    best = squares.argmax(axis=-1)[..., None, None]
    rows = np.take_along_axis(products, best, axis=-2)[..., 0, :]
    length = np.sqrt((rows * rows).sum(axis=-1, keepdims=True))
    return rows / np.where(rows[..., :1] < 0, -length, length)


def axis_rotation(axis: Array, angle_rad: float) -> Array:
    """Return the (3, 3) rotation by an angle about a unit axis: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle_rad), 1.0 - np.cos(angle_rad)
    return np.eye(3) + s * cross + c * (cross @ cross)


def orthonormalised(matrix: Array) -> Array:
    """Return (..., 3, 3) rotations with columns orthonormal up to the rounding of a few operations.

    Newton's method, one step, as the given matrices are off by a sum of rounding errors only.
    Higham: Computing the polar decomposition, with applications, 1986.
    """
    return 1.5 * matrix - 0.5 * matrix @ np.swapaxes(matrix, -1, -2) @ matrix


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
    middles, target_middle = points.mean(axis=1), target.mean(axis=1)
    moved, fixed = points - middles[:, None], target - target_middle[:, None]
    along = (moved * fixed)[..., :2].sum(axis=(1, 2))
    across = (moved[..., 0] * fixed[..., 1] - moved[..., 1] * fixed[..., 0]).sum(axis=1)
    turns = np.arctan2(across, along)
    rotations = np.zeros((len(turns), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(turns)
    rotations[:, 1, 0] = np.sin(turns)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    shifts = target_middle - (rotations @ middles[:, :, None])[..., 0]
    shifts[:, 2] = 0.0
    return rotations, shifts
