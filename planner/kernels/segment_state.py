"""State of a chain in segments as MuJoCo takes it, from its reduced state, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.module import ModuleStates

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class SegmentLayout(NamedTuple):
    """Indices of a chain's S segments in MuJoCo's state.

    Attributes:
        starts: (S,) first modules of the segments.
        hinge_qpos, hinge_dofs: (J,) indices of the hinges in ``qpos`` and ``qvel``.
        root_qpos, root_dofs: (S,) first indices of the segments' free joints there.
    """

    starts: Ints
    hinge_qpos: Ints
    hinge_dofs: Ints
    root_qpos: Ints
    root_dofs: Ints


@njit(**INNER)
def quaternion(m: Array, out: Array) -> None:
    """Write the (4,) unit quaternion of a (3, 3) rotation matrix, w ≥ 0.

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


@njit(**KERNEL)
def write_wxyzs(rotations: Array, selected: Ints, out: Array) -> None:
    """Write unit quaternions of the selected of (n, 3, 3) rotations into (k, 4), with w ≥ 0."""
    for k in range(selected.shape[0]):
        quaternion(rotations[selected[k]], out[k])


@njit(**KERNEL, nogil=True)
def write_state(
    q: Array,
    qd: Array,
    modules: ModuleStates,
    layout: SegmentLayout,
    qpos: Array,
    qvel: Array,
) -> None:
    """Write the hinges, and the poses and velocities of the segments' roots.

    Args:
        q, qd: (J,) hinge angles and rates.
        modules: Poses and velocities of all modules.
        layout: Indices in MuJoCo's state.
        qpos, qvel: MuJoCo's state; written.
    """
    starts = layout.starts
    for k in range(q.shape[0]):
        qpos[layout.hinge_qpos[k]] = q[k]
        qvel[layout.hinge_dofs[k]] = qd[k]
    wxyzs = np.empty((starts.shape[0], 4))
    write_wxyzs(modules.rotations, starts, wxyzs)
    for k in range(starts.shape[0]):
        for r in range(3):
            qpos[layout.root_qpos[k] + r] = modules.positions[starts[k], r]
        for r in range(4):
            qpos[layout.root_qpos[k] + 3 + r] = wxyzs[k, r]
    write_root_velocities(modules, starts, layout.root_dofs, qvel)


@njit(**KERNEL)
def write_root_velocities(modules: ModuleStates, starts: Ints, root_dofs: Ints, out: Array) -> None:
    """Write the velocities of the segments' roots: MuJoCo has ω in the frame of the body.

    Args:
        modules: Poses and velocities of all modules.
        starts: (S,) first modules of the segments.
        root_dofs: (S,) first indices of their free joints in ``qvel``.
        out: MuJoCo's ``qvel``; written.
    """
    for k in range(starts.shape[0]):
        i = starts[k]
        for r in range(3):
            out[root_dofs[k] + r] = modules.velocities[i, r]
            local = 0.0
            for c in range(3):
                local += modules.rotations[i, c, r] * modules.angular_velocities[i, c]
            out[root_dofs[k] + 3 + r] = local
