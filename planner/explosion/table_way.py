"""Where a chain that comes off its core on a table is to go: along the floor, clear of the core."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.explosion.from_above import Above

Array = NDArray[np.float64]
DIRECTIONS: Final = 72
"""Directions over the table in which the rod may point."""
ROOM: Final = 1.8
"""Pitches that the rod keeps from the core once it is far enough out."""
LOOKED_ALONG: Final = 12.0
"""Pitches along the rod within which it keeps away from the core."""
STRAIGHT_ON: Final = 2.0
"""How much it counts that the rod points where the chain's next link does, against what follows."""
OUTWARDS: Final = 0.3
"""How much it counts that it points away from the core's middle."""
AS_BEFORE: Final = 0.7
"""How much it counts that it points where it did."""
LACKING: Final = 3.0
"""How much each pitch counts that there is too little room."""


def way_out(above: Above, start: Array, there: Array, ahead: Array, before: Array) -> Array:
    """(3,) unit vector along the table, clear of the core.

    Args:
        above: Looks down on the table.
        start: (3,) where the way begins.
        there: (k, 3) cells of the core.
        ahead: (3,) where the core's last link points.
        before: (3,) the way of the unit before; zeros where there is none.
    """
    rays = above.along(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    outwards = above.seen(start - there.mean(axis=0)) @ above.across
    along = np.arange(1.0, LOOKED_ALONG, 0.5)
    points = above.seen(start + rays[:, None, :] * along[None, :, None])
    below = np.unique(above.seen(there), axis=0)
    gaps = points[:, :, None, :] - below
    distance = np.linalg.norm(gaps, axis=-1).min(axis=-1)
    lack = np.maximum(np.minimum(ROOM, 0.7 + 0.5 * along) - distance, 0.0).max(axis=1)
    score = (
        OUTWARDS * (rays @ outwards) / max(float(np.linalg.norm(outwards)), 1e-9)
        + STRAIGHT_ON * (rays @ ahead)
        + AS_BEFORE * (rays @ before)
        - LACKING * lack
    )
    return np.asarray(rays[int(np.argmax(score))])
