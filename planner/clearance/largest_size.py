"""Sizes: the largest module at which a motion is clear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import Sweep, sweep
from planner.motion.motion import Motion

Array = NDArray[np.float64]
FULL_SIZE: Final = 1.0
"""Module size, in pitches, at which neighbours touch: the upper limit of the search for the largest
module size without collisions."""
SIZE_STEP: Final = 0.002
"""Step, in pitches, of the search for the largest module size without collisions. Smaller values
find larger sizes and need more collision checks of the motion. Chosen."""
MAX_SIZE_STEPS: Final = 12
"""Maximum number of module sizes that are tried to find the largest one without collisions; beyond
it the search returns the size that is known to be clear. Larger values find larger sizes, more
slowly. Chosen."""


def largest_size(chain: Chain, motions: Sequence[Motion | Array], *, clear_at: float) -> float:
    """Find the largest module size, in steps of ``SIZE_STEP``, at which motions are proved clear.

    Clearance falls about linearly with the size, so that two sizes give the one where it vanishes.
    From there on down the motions are swept until they pass.

    Args:
        chain: The chain.
        motions: Motions, or the (F, J) hinge angles of each, rad.
        clear_at: A size at which they are clear.
    """
    low = min(sweep(chain, m, size=clear_at).clearance for m in motions)
    high = min(sweep(chain, m, size=FULL_SIZE).clearance for m in motions)
    if high >= 0.0:
        return FULL_SIZE
    vanishes = clear_at + (FULL_SIZE - clear_at) * low / (low - high)
    steps = int(vanishes / SIZE_STEP)
    for k in range(MAX_SIZE_STEPS):
        size = (steps - k) * SIZE_STEP
        if size <= clear_at:
            break
        if all(_clear(sweep(chain, m, size=size)) for m in motions):
            return size
    return clear_at


def _clear(found: Sweep) -> bool:
    return found.clearance >= 0.0 and found.bound > 0.0
