"""Rounding: a proved bound of what double precision changes in a distance of two modules.

The derivation is in the docstring of ``foldback_check.py``, under ROUNDING, with the same symbols.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.motion.motion import Motion

UNIT_ROUNDOFF: Final = 2.0**-53
"""Largest relative error of one operation in IEEE double precision, 2⁻⁵³. Every proved clearance is
reduced by a bound of the rounding errors, which is a multiple of it."""
BERNSTEIN_NORM: Final = 14.5
"""Factor by which the independent checker (``foldback_check.py``) amplifies rounding errors: upper
bound of the maximum norm of its matrix from values at five Chebyshev nodes to Bernstein
coefficients. Proved clearances are reduced by as much, so that a certificate states no more than
the checker can prove. Computed."""


def clearance_rounding(chain: Chain, motion: Motion, module_size: float) -> float:
    """Return the bound for any two modules of a chain in a motion, in pitches.

    That of a dense motion grows with the square of the number of modules n, as each of n links
    turns up to n links. In a windowed motion (BY PARTS), the modules in front of a window are as
    far from each other as in the folded shape, and only the links of the window turn the tail.

    Args:
        chain: The chain.
        motion: The motion.
        module_size: Module size as a fraction of the pitch.
    """
    module, joint, count, u = chain.module, chain.module.joint, len(chain), UNIT_ROUNDOFF
    hinges = module.hinges_per_joint
    angle = (10.0 * module.largest_angle_rad + 8.0) * u
    rotations = np.concatenate([joint.axes.ravel(), joint.turn.ravel()])
    is_exact = bool(np.isin(rotations, (-1.0, 0.0, 1.0)).all())
    halves = 2.0 * np.concatenate([joint.anchor, joint.offset])
    is_tail_exact = is_exact and bool((halves == np.rint(halves)).all())
    link = hinges * math.sqrt(2.0) * (2.0 * angle + 3.0 * u)
    link += (not is_exact) * (hinges + 1) * 40.0 * u
    poses = 3.0 if motion.is_windowed and not is_tail_exact else 2.0  # the third of the tail
    links = poses * (link + 24.0 * u)
    length = module.longest_link
    thickness = 2.0 * module.radius * module_size
    reach = length * count + thickness
    bound = reach * (count * links + 256.0 * u)
    if motion.is_windowed and is_tail_exact:
        folded = forward_kinematics(module, chain.folded_rad).positions
        extent = length + float(np.linalg.norm(np.ptp(folded, axis=0)))  # D
        batch = 2 * _max_moving_links(chain, motion) + 1
        moved = count * (extent + thickness) + batch * (reach + extent)
        bound = min(bound, moved * links + (reach + extent) * 256.0 * u)
    return BERNSTEIN_NORM * bound


def _max_moving_links(chain: Chain, motion: Motion) -> int:
    """Return the maximum number of links that turn between two frames of a windowed motion."""
    after = np.minimum(np.arange(len(motion)) + 1, len(motion) - 1)
    hinges = chain.module.hinges_per_joint
    low = np.minimum(motion.first, motion.first[after]) // hinges
    high = -(-np.maximum(motion.last, motion.last[after]) // hinges)
    return int((high - low).max(initial=0))
