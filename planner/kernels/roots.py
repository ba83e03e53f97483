"""Orientations of some modules as quaternions, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True)
def wxyzs_of(rotations: Array, chosen: Ints, out: Array) -> None:
    """Writes unit quaternions (w, x, y, z) of the chosen of (n, 3, 3) rotations into (k, 4)."""
    for k in range(chosen.shape[0]):
        m = rotations[chosen[k]]
        squares = (
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        )
        a = m[2, 1] - m[1, 2]
        b = m[0, 2] - m[2, 0]
        c = m[1, 0] - m[0, 1]
        d = m[1, 0] + m[0, 1]
        e = m[0, 2] + m[2, 0]
        f = m[2, 1] + m[1, 2]
        largest = max(squares)
        if squares[0] == largest:
            w, x, y, z = largest, a, b, c
        elif squares[1] == largest:
            w, x, y, z = a, largest, d, e
        elif squares[2] == largest:
            w, x, y, z = b, d, largest, f
        else:
            w, x, y, z = c, e, f, largest
        length = np.sqrt(w * w + x * x + y * y + z * z)
        out[k, 0] = w / length
        out[k, 1] = x / length
        out[k, 2] = y / length
        out[k, 3] = z / length
