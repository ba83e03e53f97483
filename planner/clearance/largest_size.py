"""Sizes: the largest module at which a motion is clear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import Sweep, sweep
from planner.motion.windows import Windows

Array = NDArray[np.float64]
FULL: Final = 1.0
"""Module size at which neighbours touch, of a pitch."""
STEP: Final = 0.002
"""Difference of two module sizes that are tried, in pitches."""
MOST_STEPS: Final = 12


def largest_size(chain: Chain, motions: Sequence[Array | Windows], *, clear_at: float) -> float:
    """The largest module size, in steps of ``STEP``, at which motions are proved clear.

    Clearance falls about evenly with the size, so that two sizes tell where it vanishes; from there
    on down the motions are swept until one passes, as the certificate sweeps them.

    Args:
        chain: The chain.
        motions: (F, J) hinge angles of each, or windows.
        clear_at: A size at which they are clear.
    """
    low = min(sweep(chain, m, size=clear_at).clearance for m in motions)
    high = min(sweep(chain, m, size=FULL).clearance for m in motions)
    if high >= 0.0:
        return FULL
    vanishes = clear_at + (FULL - clear_at) * low / (low - high)
    steps = int(vanishes / STEP)
    for k in range(MOST_STEPS):
        size = (steps - k) * STEP
        if size <= clear_at:
            break
        if all(_clear(sweep(chain, m, size=size)) for m in motions):
            return size
    return clear_at


def _clear(found: Sweep) -> bool:
    return found.clearance >= 0.0 and found.bound > 0.0
