"""Kinematics: from hinge angles and a root pose to the poses of all modules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from foldback.planner.core import many_chain_poses


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
    angles = np.ascontiguousarray(angles_rad, dtype=np.float64).reshape(-1, hinges)
    frames = len(angles)
    roots = np.zeros((frames, 3))
    turns = np.broadcast_to(np.eye(3), (frames, 3, 3)).copy()
    if root_position is not None:
        roots[:] = np.broadcast_to(root_position, (*lead, 3)).reshape(-1, 3)
    if root_wxyz is not None:
        turns[:] = matrix_from_wxyz(np.broadcast_to(root_wxyz, (*lead, 4))).reshape(-1, 3, 3)
    positions = np.empty((frames, n, 3))
    rotations = np.empty((frames, n, 3, 3))
    many_chain_poses(angles, module.joint, root, roots, turns, positions, rotations)
    return Poses(
        positions=positions.reshape(*lead, n, 3), rotations=rotations.reshape(*lead, n, 3, 3)
    )
