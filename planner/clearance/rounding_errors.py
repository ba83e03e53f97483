"""Rounding: a proved bound of what double precision changes in a distance of two modules.

The derivation is in the docstring of ``foldback_check.py``, under ROUNDING, with the same symbols.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain

UNIT_ROUNDOFF: Final = 2.0**-53
"""Largest relative error of one operation in IEEE double precision, 2⁻⁵³. Every proved clearance is
reduced by a bound of the rounding errors, which is a multiple of it."""
BERNSTEIN_NORM: Final = 14.5
"""Factor by which the independent checker (``foldback_check.py``) amplifies rounding errors: upper
bound of the maximum norm of its matrix from values at five Chebyshev nodes to Bernstein
coefficients. Proved clearances are reduced by as much, so that a certificate states no more than
the checker can prove. Computed."""


def clearance_rounding(chain: Chain, module_size: float) -> float:
    """Return the bound for any two modules of a chain, in pitches.

    Args:
        chain: The chain.
        module_size: Module size as a fraction of the pitch.
    """
    module, count, u = chain.module, len(chain), UNIT_ROUNDOFF
    hinges = module.hinges_per_joint
    angle = (10.0 * module.angle_limit_rad + 8.0) * u
    parts = np.concatenate([module.axes.ravel(), module.turn.ravel()])
    exact = bool(np.isin(parts, (-1.0, 0.0, 1.0)).all())
    link = hinges * math.sqrt(2.0) * (2.0 * angle + 3.0 * u) + (not exact) * (hinges + 1) * 40.0 * u
    length = float(np.linalg.norm(module.anchor) + np.linalg.norm(module.offset))
    reach = length * count + 2.0 * module.radius * module_size
    return BERNSTEIN_NORM * reach * (count * (2.0 * link + 48.0 * u) + 256.0 * u)
