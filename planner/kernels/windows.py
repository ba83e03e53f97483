"""Steps of hinges between windows, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(**INNER)
def angle_in(
    hinge: int, first_hinge: int, offset: int, end: int, angles: NDArray[np.float32], folded: Array
) -> float:
    """A hinge's angle: folded before the window that begins at ``first_hinge``, 0 after it."""
    if hinge < first_hinge:
        return folded[hinge]
    place = offset + hinge - first_hinge
    return float(angles[place]) if place < end else 0.0


@njit(**KERNEL)
def window_steps(
    first: Ints,
    offsets: Ints,
    angles: NDArray[np.float32],
    folded: Array,
    fraction: float,
    largest: Array,
    moving: Ints,
) -> None:
    """The largest hinge step between every frame and the next, and how many hinges take part.

    Args:
        first, offsets, angles: See ``planner.motion.motion.Motion``.
        folded: (J,) the folded angles.
        fraction: A hinge takes part when its step is more than this share of the largest.
        largest: (F − 1,) written, in radians.
        moving: (F − 1,) written.
    """
    for k in range(len(first) - 1):
        low = min(first[k], first[k + 1])
        high = max(
            first[k] + offsets[k + 1] - offsets[k],
            first[k + 1] + offsets[k + 2] - offsets[k + 1],
        )
        largest_step = 0.0
        for hinge in range(low, high):
            before = angle_in(hinge, first[k], offsets[k], offsets[k + 1], angles, folded)
            after = angle_in(hinge, first[k + 1], offsets[k + 1], offsets[k + 2], angles, folded)
            largest_step = max(largest_step, abs(after - before))
        count = 0
        if largest_step > 0.0:
            for hinge in range(low, high):
                before = angle_in(hinge, first[k], offsets[k], offsets[k + 1], angles, folded)
                after = angle_in(
                    hinge, first[k + 1], offsets[k + 1], offsets[k + 2], angles, folded
                )
                if abs(after - before) > fraction * largest_step:
                    count += 1
        largest[k] = largest_step
        moving[k] = count
