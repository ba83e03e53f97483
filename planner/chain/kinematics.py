"""Kinematics: from hinge angles and a root pose to the poses of all modules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from foldback.planner.compilation.may_compile import may_compile
from foldback.planner.kernels.module import Joint


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Poses of all modules of a chain, in the world's frame.

    Attributes:
        positions: (..., n, 3) centres in pitches.
        rotations: (..., n, 3, 3) orientations.
    """

    positions: Array
    rotations: Array

    @property
    def wxyzs(self) -> Array:
        """(..., n, 4) orientations as unit quaternions."""
        return wxyz_from_matrix(self.rotations)


def forward_kinematics(
    module: Module,
    angles_rad: Array,
    *,
    root: int = 0,
    root_position: Array | None = None,
    root_wxyz: Array | None = None,
) -> Poses:
    """Poses of all modules for any number of configurations at once.

    Args:
        module: The kind of module.
        angles_rad: (..., J) hinge angles.
        root: Index of the module whose pose is given.
        root_position: (..., 3) its centre in pitches; the origin when None.
        root_wxyz: (..., 4) its orientation; identity when None.

    Returns:
        Poses with the leading axes of ``angles_rad``.
    """
    lead = angles_rad.shape[:-1]
    hinges = angles_rad.shape[-1]
    n = module.module_count(hinges)
    # A copy: a read-only array is another type, for which all would be compiled once more.
    angles = np.array(angles_rad, dtype=np.float64, order="C").reshape(-1, hinges)
    frames = len(angles)
    roots = np.zeros((frames, 3))
    turns = np.broadcast_to(np.eye(3), (frames, 3, 3)).copy()
    if root_position is not None:
        roots[:] = np.broadcast_to(root_position, (*lead, 3)).reshape(-1, 3)
    if root_wxyz is not None:
        turns[:] = matrix_from_wxyz(np.broadcast_to(root_wxyz, (*lead, 4))).reshape(-1, 3, 3)
    positions = np.empty((frames, n, 3))
    rotations = np.empty((frames, n, 3, 3))
    if may_compile():
        from foldback.planner.kernels.kinematics import many_chain_poses as write_poses
    else:
        write_poses = _write_poses
    write_poses(angles, module.joint, root, roots, turns, positions, rotations)
    return Poses(
        positions=positions.reshape(*lead, n, 3), rotations=rotations.reshape(*lead, n, 3, 3)
    )


def _write_poses(
    angles: Array,
    joint: Joint,
    root: int,
    root_positions: Array,
    root_rotations: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Do the same as ``planner.kernels.kinematics.many_chain_poses`` with NumPy alone."""
    rigid_links, anchor, axes, turn, offset = joint
    frames, n = positions.shape[:2]
    steps = np.broadcast_to(turn, (frames, n - 1, 3, 3)).copy()
    by_hinge = angles.reshape(frames, angles.shape[1] // len(axes), len(axes))  # frames may be 0
    for k in range(len(axes) - 1, -1, -1):
        jointed = steps[:, rigid_links:]
        steps[:, rigid_links:] = _about(axes[k], by_hinge[..., k]) @ jointed
    positions[:, root], rotations[:, root] = root_positions, root_rotations
    for i in range(root, n - 1):
        np.matmul(rotations[:, i], steps[:, i], out=rotations[:, i + 1])
    for i in range(root - 1, -1, -1):
        np.matmul(rotations[:, i + 1], steps[:, i].swapaxes(1, 2), out=rotations[:, i])
    links = rotations[:, :-1] @ anchor + rotations[:, 1:] @ offset
    positions[:, root + 1 :] = links[:, root:]
    np.cumsum(positions[:, root:], axis=1, out=positions[:, root:])
    before = np.cumsum(links[:, :root][:, ::-1], axis=1)[:, ::-1]
    positions[:, :root] = positions[:, root : root + 1] - before


def _about(axis: Array, angles: Array) -> Array:
    """Return the (..., 3, 3) rotations about a unit axis by (...) angles: Rodrigues' formula."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
    return cosine * np.eye(3) + sine * across + (1.0 - cosine) * np.outer(axis, axis)
