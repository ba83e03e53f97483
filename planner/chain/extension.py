"""Extension: the distance of a chain's ends, and the hinges whose turn changes it.

A chain is extended in its rest shape, with all angles zero, and in all others whose ends are as far
apart: a hinge whose axis runs through an end of the extended chain twists it, but does not bend it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags
from foldback.planner.chain.cantilever_statics import hinge_frames
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses

TWIST_DISTANCE_PITCH: Final = 1e-9
"""Distance of an axis from the end of a chain, pitches, up to which it runs through it."""


def extended_length(chain: Chain) -> float:
    """Return the distance of the ends of an extended chain, in pitches."""
    positions = _extended(chain).positions
    return float(np.linalg.norm(positions[-1] - positions[0]))


def bending_hinges(chain: Chain) -> Flags:
    """Return (J,) flags, True for the hinges that change the distance of an extended chain's ends.

    Two points keep their distance while one of them turns about an axis that runs through either.
    """
    poses = _extended(chain)
    axes, anchors = hinge_frames(chain, np.zeros_like(chain.folded_rad), poses)
    ends: list[Array] = []
    for end in (0, -1):
        arms = np.broadcast_to((poses.positions[end] - anchors)[:, None], axes.shape)
        ends.append(np.linalg.norm(np.cross(axes, arms), axis=2).ravel())
    return np.minimum(*ends) > TWIST_DISTANCE_PITCH


def _extended(chain: Chain) -> Poses:
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    return chain.poses(np.zeros_like(chain.folded_rad), np.zeros(3), upright)
