"""Knot evidence: a check that a chain is the reported knot where its explosion stopped."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.motion.failure_schemas import KnotFigures
from foldback.planner.plan.value_differences import Differences
from foldback.planner.verification.knot_invariants import (
    crossings_of,
    invariants_of,
    invariants_of_crossings,
)

POSITION_JITTER_PITCH: Final = 1e-3
"""Maximum random shift of modules along each axis, in pitches, so that no projection for the check
of a knot is degenerate. Much larger values could change the knot."""
MAX_CLOSING_CORNERS: Final = 3
"""Maximum number of corners by which the evidence of a knot may join the chain's ends. With the two
ends, they are a polygon of five edges, which cannot be knotted; more corners could tie a knot of
their own outside of the chain."""
MIN_CLOSINGS: Final = 3
"""Minimum number of closings (lines that join a chain's ends around it) that must all show a knot
if an end cannot be extended without passing close to other modules."""


def knot_differs(positions: Array, stated: KnotFigures) -> Differences:
    """Yield the differences between the reported knot and that of a chain.

    Args:
        positions: (n, 3) centres of its modules where the explosion stopped, pitches.
        stated: The evidence.
    """
    rng = np.random.default_rng(len(positions))
    polygon, sight = np.array(stated["polygon"], dtype=np.float64), np.array(stated["sight"])
    expected = crossings_of(polygon, sight)
    diagram = [
        (crossing["over"], crossing["under"], crossing["sign"]) for crossing in stated["diagram"]
    ]
    if stated["crossings"] != len(diagram):
        yield f"crossings: got {stated['crossings']}, expected {len(diagram)}, as in the diagram"
    if len(expected) != len(diagram) or not all(
        sign == drawn_crossing[2]
        and np.allclose((over, under), drawn_crossing[:2], rtol=0.0, atol=1e-6)  # rounding
        for (over, under, sign), drawn_crossing in zip(
            sorted(expected), sorted(diagram), strict=True
        )
    ):
        yield (
            f"diagram: the {len(expected)} crossings of the polygon differ from the {len(diagram)} "
            "crossings in the evidence"
        )
        return
    drawn = invariants_of_crossings(expected)
    if not stated["closings"]:
        yield "closings: got none, expected at least one way to join the ends"
    for corners in stated["closings"]:
        outside = np.array(corners, dtype=np.float64).reshape(-1, 3)
        yield from _closing_differs(
            positions, outside, several=len(stated["closings"]) >= MIN_CLOSINGS
        )
        moved = positions + rng.uniform(
            -POSITION_JITTER_PITCH, POSITION_JITTER_PITCH, positions.shape
        )
        invariants = invariants_of(np.concatenate([moved, outside]), rng)
        if invariants is None or drawn is None:
            yield "determinant: there are too many crossings to compute it again"
            return
        if not invariants.knotted:
            yield (
                "knot: got evidence of a knot, but the chain's Alexander polynomial, computed at "
                "two points, shows no knot"
            )
        if stated["determinant"] not in (None, invariants.determinant):
            yield f"determinant: got {stated['determinant']}, expected {invariants.determinant}"
        if drawn != invariants:
            yield (
                f"polygon: got a knot with the determinant {drawn.determinant}, expected a knot "
                f"with the determinant {invariants.determinant} and the polynomial of the chain"
            )


def _closing_differs(positions: Array, corners: Array, *, several: bool) -> Differences:
    """Yield the reasons why a closing of the ends may tie a knot, or undo one."""
    if not len(corners):
        apart = float(np.linalg.norm(positions[-1] - positions[0]))
        if apart > 1.1:
            yield (
                "closings: got no corners, expected some, because the ends are "
                f"{apart:.3g} pitches apart"
            )
        return
    if len(corners) > MAX_CLOSING_CORNERS:
        yield f"closings: got {len(corners)} corners, expected at most {MAX_CLOSING_CORNERS}"
    middle = positions.mean(axis=0)
    radius = float(np.linalg.norm(positions - middle, axis=1).max())
    if np.linalg.norm(corners - middle, axis=1).min() < 2.0 * radius:  # outside of the chain
        yield "closings: got a corner near the chain, expected all corners far outside the chain"
    for start, end in zip(corners[:-1], corners[1:], strict=True):
        if _distances(middle[None], start, end)[0] < radius:
            yield "closings: got a line through the chain, expected lines around the chain"
    if several:
        return
    for end, corner in ((0, corners[-1]), (len(positions) - 1, corners[0])):
        other_points = np.delete(positions, end, axis=0)
        # a closer line might cross the chain
        if _distances(other_points, positions[end], corner).min() < 0.5:
            yield (
                f"closings: the line from module {end} crosses other modules; this is allowed "
                f"only if there are at least {MIN_CLOSINGS} closings"
            )


def _distances(points: Array, start: Array, end: Array) -> Array:
    """Return the (m,) distances of (m, 3) points from a line segment."""
    way = end - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * way, axis=1))
