"""Which hinges bring modules too close to each other, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import KERNEL
from planner.kernels.clearance import pair_separation
from planner.kernels.kinematics import poses_from_rest
from planner.kernels.module import Hull, Joint
from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]


@njit(**KERNEL)
def blamed_hinges(
    angles: Array,
    joint: Joint,
    hull: Hull,
    apart: int,
    size: float,
    margin: float,
    blamed: NDArray[np.bool_],
) -> int:
    """Marks the hinges between two modules that are closer than a margin.

    How two modules lie to each other depends on the hinges between them and on no others.

    Args:
        angles: (F, J) configurations.
        joint, hull: Of the module.
        apart: Pairs fewer links apart don't count.
        size: Module size as a fraction of the pitch.
        margin: Least clearance.
        blamed: (F, J) written.

    Returns:
        How many configurations have such a pair.
    """
    frames, hinges = angles.shape
    rigid_links = joint.rigid_links
    a_joint = joint.axes.shape[0]
    n = hinges // a_joint + 1 + rigid_links
    positions = np.empty((n, 3))
    rotations = np.empty((n, 3, 3))
    change = np.empty(hinges + 1, dtype=np.int64)
    found = 0
    for f in range(frames):
        poses_from_rest(angles[f], joint, n // 2, positions, rotations)
        pairs = near_pairs(positions, 2.0 * hull.radius * size + margin, apart)
        change[:] = 0
        close = False
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            separation = pair_separation(
                positions[j] - positions[i], rotations[i], rotations[j], hull, size, margin
            )
            if separation < margin:
                close = True
                change[max(0, i - rigid_links) * a_joint] += 1
                change[max(0, j - rigid_links) * a_joint] -= 1
        found += close
        between = 0
        for h in range(hinges):
            between += change[h]
            blamed[f, h] = between > 0
    return found


@njit(**KERNEL)
def displacements(
    angles: Array,
    joint: Joint,
    largest: Array,
    mean: Array,
) -> None:
    """Writes (F − 1,) how far modules move from frame to frame, the most and on average.

    The centre of mass and the orientation of the middle module are held still.
    """
    frames, hinges = angles.shape
    n = hinges // joint.axes.shape[0] + 1 + joint.rigid_links
    centres = np.empty((2, n, 3))
    rotations = np.empty((n, 3, 3))
    for f in range(frames):
        now = centres[f % 2]
        poses_from_rest(angles[f], joint, n // 2, now, rotations)
        for r in range(3):
            middle = now[:, r].mean()
            for i in range(n):
                now[i, r] -= middle
        if f == 0:
            continue
        before = centres[1 - f % 2]
        most = 0.0
        total = 0.0
        for i in range(n):
            x = now[i, 0] - before[i, 0]
            y = now[i, 1] - before[i, 1]
            z = now[i, 2] - before[i, 2]
            moved = np.sqrt(x * x + y * y + z * z)
            most = max(most, moved)
            total += moved
        largest[f - 1] = most
        mean[f - 1] = total / n
