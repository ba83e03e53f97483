"""Cantilever statics: hinge torques under gravity of a chain that is held at its root alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.chain.rotations import matrix_from_wxyz

GRAVITY_M_S2: Final = 9.81
"""Standard acceleration of gravity, rounded, in m/s²."""


def static_torque(chain: Chain, angles_rad: Array) -> float:
    """The largest hinge torque under gravity in its worst direction, in units of m g · pitch.

    For a hinge with axis a and the modules beyond it at distances r from it, the torque is
    g |a × Σ m r| when gravity points the worst way.

    Args:
        chain: The chain, held at its root.
        angles_rad: (J,) configuration.
    """
    poses = chain.poses(angles_rad, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    axes, anchors = hinge_frames(chain, angles_rad, poses)
    n, masses = len(chain), chain.module.masses(len(chain))
    mass = np.concatenate([[0.0], np.cumsum(masses)])
    upto = np.concatenate([np.zeros((1, 3)), np.cumsum(masses[:, None] * poses.positions, axis=0)])
    joints = chain.module.rigid_links + np.arange(len(anchors))
    outer = (joints >= chain.root)[:, None]  # what hangs on it comes after the joint
    carried = mass[joints + 1, None]
    sums = np.where(outer, upto[n] - upto[joints + 1], upto[joints + 1])
    beyond = sums - np.where(outer, mass[n] - carried, carried) * anchors
    torques = np.linalg.norm(np.cross(axes, beyond[:, None]), axis=2)
    return float(torques.max(initial=0.0))


def hinge_frames(chain: Chain, angles_rad: Array, poses: Poses) -> tuple[Array, Array]:
    """World axes (joints, hinges, 3) and anchors (joints, 3) of one configuration's hinges."""
    module = chain.module
    first = module.rigid_links
    rotations = poses.rotations[first:-1]
    joint = module.joint
    rows = joint.row(np.arange(first, len(chain) - 1))
    anchors = poses.positions[first:-1] + _turned(rotations, joint.anchor[rows])
    angles = angles_rad.reshape(-1, module.hinges_per_joint)
    axes = np.empty((len(anchors), module.hinges_per_joint, 3))
    frames = rotations
    for k in range(module.hinges_per_joint):
        axis = joint.axes[rows, k]
        axes[:, k] = _turned(frames, axis)
        half = 0.5 * angles[:, k, None]
        wxyz = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
        frames = frames @ matrix_from_wxyz(wxyz)
    return axes, anchors


def _turned(rotations: Array, vectors: Array) -> Array:
    """Return (n, 3) vectors, each turned by the rotation of the same index."""
    return (rotations @ vectors[:, :, None])[:, :, 0]
