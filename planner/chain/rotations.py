"""Rotations: quaternions (w, x, y, z) and matrices, any number of leading axes."""

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

    rows = np.ascontiguousarray(matrix, dtype=np.float64).reshape(-1, 3, 3)
    rows.setflags(write=False)
    out = np.empty((len(rows), 4))
    quaternions(rows, out)
    return out.reshape(*np.shape(matrix)[:-2], 4)
