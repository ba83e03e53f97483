"""A chain on a table, seen from above: where its links point, and whether it lies over itself.

A chain cannot twist: a loop in which it lies over itself tightens when it is drawn straight, and
never opens. And a tail that is to go round must go the way that takes its turns back: the short way
to the same direction may be the one that makes a loop. So turns are counted past a full one.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEEP: Final = 0.3
"""Share of a link's length that is seen from above, below which it points nowhere."""
SPAN: Final = 3
"""Links over which the way is taken that a chain goes: single ones may be steep."""
APART: Final = 3
"""Links of which the first and the last may cross: nearer ones meet at a joint, or stand."""
AT_MOST_ROUND: Final = 1.25 * np.pi
"""Radians by which a way may be round from another one, whichever way round."""


class Above:
    """Looks down on a table.

    Args:
        up: (3,) away from the table, along an axis.
    """

    def __init__(self, up: Array) -> None:
        one = np.eye(3)[int(np.argmin(np.abs(up)))]
        self.up = up
        self.across: Array = np.stack([one, np.cross(up, one).astype(np.float64)])
        """(2, 3) unit vectors along the table."""

    def seen(self, vectors: Array) -> Array:
        """(..., 2) what is seen of (..., 3) vectors."""
        return vectors @ self.across.T

    def along(self, angles: Array) -> Array:
        """(..., 3) unit vectors along the table, at (...,) radians."""
        return np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ self.across

    def angle(self, vector: Array) -> float:
        """Where a vector points, in radians."""
        x, y = self.seen(vector)
        return float(np.arctan2(y, x))

    def turned(self, positions: Array, first: Array, last: Array) -> Array:
        """(m - 1,) by how much each link is turned against the first, counted past full turns.

        Args:
            positions: (m, 3) centres of modules, three at least.
            first, last: (3,) where the first and the last link point.
        """
        ways = (positions[SPAN:] - positions[:-SPAN]) / SPAN
        seen = self.seen(np.vstack([first, ways, last]))
        points = np.hypot(seen[:, 0], seen[:, 1]) > STEEP
        points[0] = True
        turns = wrapped(np.diff(np.arctan2(seen[points, 1], seen[points, 0])))
        counted = np.concatenate([[0.0], np.cumsum(turns)])
        return counted[np.cumsum(points) - 1]  # steep ones are turned as the one before


def wrapped(angles: Array) -> Array:
    """The same directions, from −π to π."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def nearest_way(angle: float, counted: float) -> float:
    """The same direction as an angle, counted so that it is near another one, but not far round."""
    once = float(wrapped(np.array(angle)))
    ways = [way for way in (once, once - 2.0 * np.pi, once + 2.0 * np.pi)]
    return min(
        (way for way in ways if abs(way) <= AT_MOST_ROUND), key=lambda way: abs(way - counted)
    )


def crosses_itself(points: Array) -> bool:
    """Whether a line through (m, 2) points crosses itself."""
    begin, way = points[:-1], np.diff(points, axis=0)
    x, y = way.T
    between = begin[None] - begin[:, None]
    across = x[:, None] * y - y[:, None] * x
    with np.errstate(divide="ignore", invalid="ignore"):
        on_first = (between[..., 0] * y - between[..., 1] * x) / across
        on_second = (between[..., 0] * y[:, None] - between[..., 1] * x[:, None]) / across
    inside = (on_first > 0.0) & (on_first < 1.0) & (on_second > 0.0) & (on_second < 1.0)
    return bool(np.triu(inside, APART).any())
