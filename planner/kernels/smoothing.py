"""Which hinges bring modules too close to each other, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels.clearance import pair_separation
from planner.kernels.kinematics import chain_poses
from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]


@njit(cache=True)
def blamed_hinges(
    angles: Array,
    rigid_links: int,
    anchor: Array,
    axes: Array,
    turn: Array,
    offset: Array,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    apart: int,
    size: float,
    margin: float,
    blamed: NDArray[np.bool_],
) -> int:
    """Marks the hinges between two modules that are closer than a margin.

    How two modules lie to each other depends on the hinges between them and on no others.

    Args:
        angles: (F, J) configurations.
        rigid_links, anchor, axes, turn, offset, vertices, normals, edges, radius, apart: The
            module, see ``planner.modules.Module``.
        size: Module size as a fraction of the pitch.
        margin: Least clearance.
        blamed: (F, J) written.

    Returns:
        How many configurations have such a pair.
    """
    frames, hinges = angles.shape
    a_joint = axes.shape[0]
    n = hinges // a_joint + 1 + rigid_links
    positions = np.empty((n, 3))
    rotations = np.empty((n, 3, 3))
    origin = np.zeros(3)
    upright = np.eye(3)
    change = np.empty(hinges + 1, dtype=np.int64)
    found = 0
    for f in range(frames):
        chain_poses(
            angles[f],
            rigid_links,
            anchor,
            axes,
            turn,
            offset,
            n // 2,
            origin,
            upright,
            positions,
            rotations,
        )
        pairs = near_pairs(positions, 2.0 * radius * size + margin, apart)
        change[:] = 0
        close = False
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            separation = pair_separation(
                positions[j] - positions[i],
                rotations[i],
                rotations[j],
                vertices,
                normals,
                edges,
                size,
                margin,
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


@njit(cache=True)
def limit_slopes(shares: Array, most: Array) -> None:
    """Lowers (F, J) shares until from frame to frame none rises by more than ``most``, (F, J)."""
    frames, hinges = shares.shape
    for k in range(1, frames):
        for h in range(hinges):
            shares[k, h] = min(shares[k, h], shares[k - 1, h] + most[k, h])
    for k in range(frames - 2, -1, -1):
        for h in range(hinges):
            shares[k, h] = min(shares[k, h], shares[k + 1, h] + most[k, h])
