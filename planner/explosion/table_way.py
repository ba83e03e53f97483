"""Exit direction of a chain that comes off its core on a table: along it, clear of the core."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.explosion.from_above import Above

Array = NDArray[np.float64]
HEADING_COUNT: Final = 72
"""Number of directions along the table that are tested, evenly over a full turn. Chosen."""
HEADING_CLEARANCE_PITCH: Final = 1.8
"""Wanted distance of the rod from the core, pitches; near its start it is less. Larger values
choose freer directions. Chosen."""
HEADING_LENGTH_PITCH: Final = 12.0
"""Length of the rod that is checked against the core, pitches. Chosen."""
AHEAD_WEIGHT: Final = 2.0
"""Weight of the cosine between the rod and the chain's next link in the score of a direction; the
following weights are relative to it. Chosen."""
OUTWARD_WEIGHT: Final = 0.3
"""Weight of the cosine between the rod and the direction away from the core's middle. Chosen."""
PREVIOUS_HEADING_WEIGHT: Final = 0.7
"""Weight of the cosine between the rod and its direction before. Larger values turn it less.
Chosen."""
CLEARANCE_DEFICIT_WEIGHT: Final = 3.0
"""Weight of each pitch of distance from the core that is lacking, subtracted. Chosen."""


def way_out(above: Above, start: Array, there: Array, ahead: Array, before: Array) -> Array:
    """Return the (3,) unit vector along the table, clear of the core.

    Args:
        above: Projection onto the table.
        start: (3,) start of the rod.
        there: (k, 3) cells of the core.
        ahead: (3,) direction of the core's last link.
        before: (3,) direction of the unit before; zeros if there is none.
    """
    rays = above.along(2.0 * np.pi * np.arange(HEADING_COUNT) / HEADING_COUNT)
    outwards = above.seen(start - there.mean(axis=0)) @ above.across
    along = np.arange(1.0, HEADING_LENGTH_PITCH, 0.5)
    points = above.seen(start + rays[:, None, :] * along[None, :, None])
    below = np.unique(above.seen(there), axis=0)
    gaps = points[:, :, None, :] - below
    distance = np.linalg.norm(gaps, axis=-1).min(axis=-1)
    lack = np.maximum(np.minimum(HEADING_CLEARANCE_PITCH, 0.7 + 0.5 * along) - distance, 0.0).max(
        axis=1
    )
    score = (
        OUTWARD_WEIGHT * (rays @ outwards) / max(float(np.linalg.norm(outwards)), 1e-9)
        + AHEAD_WEIGHT * (rays @ ahead)
        + PREVIOUS_HEADING_WEIGHT * (rays @ before)
        - CLEARANCE_DEFICIT_WEIGHT * lack
    )
    return np.asarray(rays[int(np.argmax(score))])
