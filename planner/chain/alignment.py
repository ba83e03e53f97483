"""Alignment: laying one set of points over another without deforming it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
