"""Hinges that bring modules too close to each other, and displacements of modules, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import KERNEL
from foldback.planner.kernels.clearance import pair_separation
from foldback.planner.kernels.kinematics import poses_at_origin
from foldback.planner.kernels.module import Hull, Joint
from foldback.planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]


@njit(**KERNEL)
def mark_blamed_hinges(
    q: Array,
    joint: Joint,
    hull: Hull,
    apart: int,
    size: float,
    margin: float,
    blamed: NDArray[np.bool_],
) -> int:
    """Mark the hinges between two modules that are closer than a margin.

    The relative pose of two modules depends on the hinges between them and on no others.

    Args:
        q: (F, J) configurations, in rad.
        joint, hull: The module's joint and hull.
        apart: Pairs fewer links apart are exempt.
        size: Module size as a fraction of the pitch.
        margin: Smallest clearance, in pitches.
        blamed: (F, J) written.

    Returns:
        Number of configurations with such a pair.
    """
    frames, hinges = q.shape
    rigid_links = joint.rigid_links
    per_joint = joint.axes.shape[0]
    n = hinges // per_joint + 1 + rigid_links
    positions = np.empty((n, 3))
    rotations = np.empty((n, 3, 3))
    change = np.empty(hinges + 1, dtype=np.int64)
    count = 0
    for f in range(frames):
        poses_at_origin(q[f], joint, n // 2, positions, rotations)
        pairs = near_pairs(positions, 2.0 * hull.radius * size + margin, apart)
        change[:] = 0
        is_close = False
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            separation = pair_separation(
                positions[j] - positions[i], rotations[i], rotations[j], hull, size, margin
            )
            if separation < margin:
                is_close = True
                change[max(0, i - rigid_links) * per_joint] += 1
                change[max(0, j - rigid_links) * per_joint] -= 1
        count += is_close
        close_pairs = 0
        for h in range(hinges):
            close_pairs += change[h]
            blamed[f, h] = close_pairs > 0
    return count


@njit(**KERNEL)
def write_displacements(q: Array, joint: Joint, largest: Array, mean: Array) -> None:
    """Write the displacements of modules from frame to frame, in pitches.

    The centre of mass and the orientation of the middle module are held still.

    Args:
        q: (F, J) configurations, in rad.
        joint: The module's joint.
        largest, mean: (F − 1,) written: over all modules.
    """
    frames, hinges = q.shape
    n = hinges // joint.axes.shape[0] + 1 + joint.rigid_links
    centres = np.empty((2, n, 3))
    rotations = np.empty((n, 3, 3))
    for f in range(frames):
        present = centres[f % 2]
        poses_at_origin(q[f], joint, n // 2, present, rotations)
        for r in range(3):
            middle = present[:, r].mean()
            for i in range(n):
                present[i, r] -= middle
        if f == 0:
            continue
        before = centres[1 - f % 2]
        farthest = 0.0
        total = 0.0
        for i in range(n):
            x = present[i, 0] - before[i, 0]
            y = present[i, 1] - before[i, 1]
            z = present[i, 2] - before[i, 2]
            displacement = np.sqrt(x * x + y * y + z * z)
            farthest = max(farthest, displacement)
            total += displacement
        largest[f - 1] = farthest
        mean[f - 1] = total / n
