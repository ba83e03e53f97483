"""Statics: what gravity asks of the hinges of a chain that is held at its root, unsupported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import Poses
from planner.chain.rotations import matrix_from_wxyz

Array = NDArray[np.float64]


def static_torque(chain: Chain, angles_rad: Array) -> float:
    """The largest hinge torque under gravity in its worst direction, in units of m g · pitch.

    For a hinge with axis a and the modules beyond it at distances r from it, the torque is
    m g |a × Σ r| when gravity points the worst way.

    Args:
        chain: The chain, held at its root.
        angles_rad: (J,) configuration.
    """
    poses = chain.poses(angles_rad, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    axes, anchors = hinge_frames(chain, angles_rad, poses)
    n = len(chain)
    upto = np.concatenate([np.zeros((1, 3)), np.cumsum(poses.positions, axis=0)])
    worst = 0.0
    for k in range(len(anchors)):
        joint = chain.module.rigid_links + k
        if joint >= chain.root:
            beyond = upto[n] - upto[joint + 1] - (n - joint - 1) * anchors[k]
        else:
            beyond = upto[joint + 1] - (joint + 1) * anchors[k]
        worst = max(worst, float(np.linalg.norm(np.cross(axes[k], beyond), axis=1).max()))
    return worst


def hinge_frames(chain: Chain, angles_rad: Array, poses: Poses) -> tuple[Array, Array]:
    """World axes (joints, hinges, 3) and anchors (joints, 3) of one configuration's hinges."""
    module = chain.module
    first = module.rigid_links
    rotations = poses.rotations[first:-1]
    anchors = poses.positions[first:-1] + rotations @ module.anchor
    angles = angles_rad.reshape(-1, module.hinges_per_joint)
    axes = np.empty((len(anchors), module.hinges_per_joint, 3))
    frames = rotations
    for k, axis in enumerate(module.axes):
        axes[:, k] = frames @ axis
        half = 0.5 * angles[:, k, None]
        wxyz = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
        frames = frames @ matrix_from_wxyz(wxyz)
    return axes, anchors
