"""What MuJoCo is told of the reduced state of a chain in segments, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import KERNEL
from planner.kernels.rotations import quaternion

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(**KERNEL)
def wxyzs_of(rotations: Array, chosen: Ints, out: Array) -> None:
    """Writes unit quaternions of the chosen of (n, 3, 3) rotations into (k, 4), with w ≥ 0."""
    for k in range(chosen.shape[0]):
        quaternion(rotations[chosen[k]], out[k])


@njit(**KERNEL, nogil=True)
def write_state(
    angles: Array,
    rates: Array,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
    starts: Ints,
    hinge_qpos: Ints,
    hinge_dofs: Ints,
    root_qpos: Ints,
    root_dofs: Ints,
    qpos: Array,
    qvel: Array,
) -> None:
    """Writes hinges and the poses and velocities of the segments' roots.

    Args:
        angles, rates: (J,) of the hinges.
        positions, rotations, velocities, spins: Of all n modules, in the world's frame.
        starts: (S,) the segments' first modules.
        hinge_qpos, hinge_dofs: (J,) where the hinges are.
        root_qpos, root_dofs: (S,) where the segments' free joints begin.
        qpos, qvel: Written.
    """
    for k in range(angles.shape[0]):
        qpos[hinge_qpos[k]] = angles[k]
        qvel[hinge_dofs[k]] = rates[k]
    wxyzs = np.empty((starts.shape[0], 4))
    wxyzs_of(rotations, starts, wxyzs)
    for k in range(starts.shape[0]):
        for r in range(3):
            qpos[root_qpos[k] + r] = positions[starts[k], r]
        for r in range(4):
            qpos[root_qpos[k] + 3 + r] = wxyzs[k, r]
    write_root_velocities(rotations, velocities, spins, starts, root_dofs, qvel)


@njit(**KERNEL)
def write_root_velocities(
    rotations: Array, velocities: Array, spins: Array, starts: Ints, root_dofs: Ints, out: Array
) -> None:
    """Writes the segments' velocities as MuJoCo has them: spins in their own frames."""
    for k in range(starts.shape[0]):
        i = starts[k]
        for r in range(3):
            out[root_dofs[k] + r] = velocities[i, r]
            local = 0.0
            for c in range(3):
                local += rotations[i, c, r] * spins[i, c]
            out[root_dofs[k] + 3 + r] = local
