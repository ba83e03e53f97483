"""Table projection: headings of the links of a chain on a table, and crossings of itself.

A chain cannot twist: a loop in which it lies over itself tightens when it is drawn straight, and
never opens. And a tail that is to go round must go the way that takes its turns back: the short way
to the same direction may be the one that makes a loop. So turns are counted past a full one.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array

HEADING_LINKS: Final = 3
"""Number of consecutive links (lines between neighbouring modules' centres) over which the
direction of a chain on the table is averaged, as single links may be steep. The directions count
how often the chain turns around."""
MAX_HEADING_CHANGE_RAD: Final = 1.25 * np.pi
"""Maximum angle, rad, to either side, between the heading (direction in the table's plane) of the
first link that moves and the heading that the chain's tail is turned towards."""


class TableProjection:
    """Projection onto a table.

    Args:
        up: (3,) unit normal of the table, along an axis of the frame of the core.
    """

    def __init__(self, up: Array) -> None:
        unit_axis = np.eye(3)[int(np.argmin(np.abs(up)))]
        self.up = up
        self.across: Array = np.stack([unit_axis, np.cross(up, unit_axis).astype(np.float64)])
        """(2, 3) unit vectors along the table."""

    def project(self, vectors: Array) -> Array:
        """Return the (..., 2) projections of (..., 3) vectors."""
        return vectors @ self.across.T

    def along(self, angles: Array) -> Array:
        """Return (..., 3) unit vectors along the table, at (...,) angles, rad."""
        return np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ self.across

    def angle(self, vector: Array) -> float:
        """Return the heading of a vector, rad."""
        x, y = self.project(vector)
        return float(np.arctan2(y, x))

    def turned(self, positions: Array, first: Array, last: Array) -> Array:
        """Return (m - 1,) headings of links relative to the first, rad, counted past full turns.

        Args:
            positions: (m, 3) centres of modules, three at least.
            first, last: (3,) directions of the first and the last link.
        """
        ways = (positions[HEADING_LINKS:] - positions[:-HEADING_LINKS]) / HEADING_LINKS
        projected = self.project(np.vstack([first, ways, last]))
        # steeper links take the direction of the link before
        points = np.hypot(projected[:, 0], projected[:, 1]) > 0.3
        points[0] = True
        turns = wrapped(np.diff(np.arctan2(projected[points, 1], projected[points, 0])))
        counted = np.concatenate([[0.0], np.cumsum(turns)])
        return counted[np.cumsum(points) - 1]  # steep ones are turned as the one before


def wrapped(angles: Array) -> Array:
    """Return angles wrapped to −π…π, rad."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def unwrap_near(angle: float, counted: float) -> float:
    """Return an angle, rad, unwrapped to be near another one, within ``MAX_HEADING_CHANGE_RAD``."""
    once = float(wrapped(np.array(angle)))
    ways = [way for way in (once, once - 2.0 * np.pi, once + 2.0 * np.pi)]
    return min(
        (way for way in ways if abs(way) <= MAX_HEADING_CHANGE_RAD),
        key=lambda way: abs(way - counted),
    )


def crosses_itself(points: Array) -> bool:
    """Return True if a line through (m, 2) points crosses itself."""
    starts, way = points[:-1], np.diff(points, axis=0)
    x, y = way.T
    between = starts[None] - starts[:, None]
    across = x[:, None] * y - y[:, None] * x
    with np.errstate(divide="ignore", invalid="ignore"):
        on_first = (between[..., 0] * y - between[..., 1] * x) / across
        on_second = (between[..., 0] * y[:, None] - between[..., 1] * x[:, None]) / across
    inside = (on_first > 0.0) & (on_first < 1.0) & (on_second > 0.0) & (on_second < 1.0)
    return bool(np.triu(inside, 3).any())  # nearer links share a joint or stand upright
