"""Diagrams of knots: a small polygon that is knotted as a chain is, and its crossings as seen.

With it another program can draw the knot, and check that it is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.kernels.knots import simplified, tightened
from planner.pathfinding.knots import Knot, best_view, closed_polygons, knot_of, smaller

Array = NDArray[np.float64]
SHORTENED: Final = 60
"""Rounds in which a polygon is drawn tight, so that the far corners at its ends come near."""
PULLS: Final = (0.9, 0.5, 0.7)
"""Shares of the way to the middle of its neighbours that a vertex is pulled, in turn."""
MOST_SHORTENED: Final = 400
"""Vertices above which a polygon is left as it is: each round takes time by their square."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagram:
    """A knotted chain, seen with few crossings.

    Attributes:
        knot: What is proved of the chain.
        closings: (k, 3) each, corners by which the chain's last module is joined to its first one;
            the knot is the same with each of them. Without corners where the ends touch.
        vertices: (n, 3) of a closed polygon of that knot.
        sight: (3,) the direction in which it is seen, pointing at who looks.
        places: (c, 2) where along the polygon the upper and the lower strand of a crossing are, as
            edge plus fraction.
        signs: (c,) of the crossings.
    """

    knot: Knot
    closings: tuple[Array, ...]
    vertices: Array
    sight: Array
    places: Array
    signs: NDArray[np.int64]


def diagram_of(centres: ArrayLike) -> Diagram | None:
    """A diagram of a chain that is proved to be knotted; None of any other.

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
    for k in range(SHORTENED if len(best) <= MOST_SHORTENED else 0):
        shorter = simplified(tightened(best, PULLS[k % len(PULLS)]))
        found = best_view(shorter, rng)
        if len(found[2]) <= len(signs):
            sight, places, signs = found
            best = shorter
    return Diagram(
        knot=knot,
        closings=tuple(polygon[len(points) :] + middle for polygon in polygons),
        vertices=best + middle,
        sight=sight,
        places=places,
        signs=signs,
    )
