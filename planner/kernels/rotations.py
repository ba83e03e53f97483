"""The quaternion of a rotation matrix, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER

Array = NDArray[np.float64]


@njit(**INNER)
def quaternion(m: Array, out: Array) -> None:
    """Write the (4,) unit quaternion of a (3, 3) matrix, w ≥ 0.

    It is a row of the outer product of the quaternion with itself, times four: that with the
    largest square, which loses the least.
    """
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    best, largest = 0, 1 + trace
    for k in range(3):
        square = 1 + 2 * m[k, k] - trace
        if square > largest:
            best, largest = k + 1, square
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    if best == 0:
        w, x, y, z = largest, a, b, c
    elif best == 1:
        w, x, y, z = a, largest, d, e
    elif best == 2:
        w, x, y, z = b, d, largest, f
    else:
        w, x, y, z = c, e, f, largest
    length = np.sqrt(w * w + x * x + y * y + z * z)
    if w < 0:
        length = -length
    out[0] = w / length
    out[1] = x / length
    out[2] = y / length
    out[3] = z / length
