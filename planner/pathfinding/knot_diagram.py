"""Diagrams of knots: a small polygon that is knotted as a chain is, and its crossings as seen.

With it another program can draw the knot, and check that it is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Array, Ints
from foldback.planner.core import simplified, tightened
from foldback.planner.pathfinding.knots import Knot, best_view, closed_polygons, knot_of, smaller

PULL_FRACTIONS: Final = (0.9, 0.5, 0.7)
"""Fraction of the way to the midpoint of its neighbours by which a vertex moves when a polygon is
shortened for a knot diagram, used by rounds in turn."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagram:
    """A knotted chain, seen with few crossings.

    Attributes:
        knot: Proved knot of the chain.
        closings: (k, 3) corners of each closure from the last module to the first one; the knot is
            the same with each. No corners if the ends touch.
        vertices: (n, 3) vertices of a closed polygon of that knot.
        sight: (3,) direction of view, towards the viewer.
        places: (c, 2) position of the upper and the lower strand of a crossing along the polygon:
            edge plus fraction.
        signs: (c,) signs of the crossings.
    """

    knot: Knot
    closings: tuple[Array, ...]
    vertices: Array
    sight: Array
    places: Array
    signs: Ints


def diagram_of(centres: ArrayLike) -> Diagram | None:
    """Return a diagram of a chain that is proved to be knotted; else None.

    Args:
        centres: (n, 3) centres in order, in pitches.
    """
    points = np.asarray(centres, dtype=np.float64)
    knot = knot_of(points)
    if knot.verdict != "knotted":
        return None
    middle = points.mean(axis=0)
    rng = np.random.default_rng(len(points))
    polygons = closed_polygons(points - middle, rng)
    best = min((smaller(polygon, rng)[1] for polygon in polygons), key=len)
    sight, places, signs = best_view(best, rng)
    for k in range(60 if len(best) <= 400 else 0):  # a round takes time by the square of the number
        shorter = simplified(tightened(best, PULL_FRACTIONS[k % len(PULL_FRACTIONS)]))
        view = best_view(shorter, rng)
        if len(view[2]) <= len(signs):
            sight, places, signs = view
            best = shorter
    return Diagram(
        knot=knot,
        closings=tuple(polygon[len(points) :] + middle for polygon in polygons),
        vertices=best + middle,
        sight=sight,
        places=places,
        signs=signs,
    )
