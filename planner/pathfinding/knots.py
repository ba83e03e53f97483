"""Knots of folded chains whose ends are drawn out to infinity.

An unknotted chain may still be stuck, as modules are thick; a knotted one can never be straightened
without an end slipping back. The chain is closed far outside and made smaller by leaving out
vertices. Three vertices are left of most unknots. Of what stays larger the Alexander polynomial is
taken at −1, exactly, and at another place modulo primes: a knot is proved where it is no unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log2, prod
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Array, Ints
from foldback.planner.core import crossings as seen_crossings
from foldback.planner.core import determinant as determinant_modulo
from foldback.planner.core import simplified, tightened
from foldback.planner.errors import InputError

Verdict = Literal["unknot", "knotted", "undecided"]

KNOT_JITTER: Final = 0.01
"""Maximum random shift of a chain's vertices along each axis, in pitches, so that no projection for
the knot test is degenerate. Strands are 0.5 apart, so a much larger value could change the knot."""
MIN_STICKS: Final = 6
"""Minimum number of edges of a closed polygon that can be knotted: six, the stick number of the
trefoil knot. Shorter ones need no test."""
SECOND_EVALUATION_POINT: Final = 2
"""Argument besides −1 at which the knot test evaluates the Alexander polynomial: at −1 alone, some
knots (the torus knot of 3 and 5) look like no knot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Knot:
    """Knot of a chain, as far as it is known.

    Attributes:
        verdict: ``unknot`` or ``knotted`` if proved, else ``undecided``.
        determinant: |Δ(−1)|: 1 for the unknot, 3 for a trefoil; None where it was not computed.
        crossings: Number of crossings of the smallest diagram that was found.
    """

    verdict: Verdict
    determinant: int | None
    crossings: int

    def __str__(self) -> str:
        if self.verdict == "knotted" and self.determinant is not None:
            return f"knotted (determinant {self.determinant})"
        return self.verdict


UNKNOT: Final = Knot(verdict="unknot", determinant=1, crossings=0)


def knot_of(cells: ArrayLike, *, closed: bool = False) -> Knot:
    """Find the knot of a chain.

    Ends that touch go out side by side, which is as if they were joined. Otherwise an end with a
    free way out goes that way, and one that has none is drawn out in several directions; where
    these do not agree the verdict is ``undecided``.

    Args:
        cells: (n, 3) centres in order, in pitches; neighbours in space a pitch apart or so.
        closed: True if the last cell is joined to the first one instead.

    Returns:
        The knot; the same cells always give the same answer.

    Raises:
        InputError: ``not-cells``: the array has another shape or holds no finite numbers.
    """
    points = np.asarray(cells, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(
            "not-cells",
            f"got an array of shape {points.shape}, expected finite numbers in an array of shape "
            "(n, 3).",
        )
    if len(points) < (MIN_STICKS if closed else 3):
        return UNKNOT
    rng = np.random.default_rng(len(points))
    polygons = closed_polygons(points - points.mean(axis=0), rng, closed=closed)
    knots = [knot_of_polygon(polygon, rng) for polygon in polygons]
    if len({(knot.verdict, knot.determinant) for knot in knots}) == 1:
        return knots[0]
    return Knot(verdict="undecided", determinant=None, crossings=min(k.crossings for k in knots))


def knot_of_polygon(polygon: Array, rng: np.random.Generator) -> Knot:
    """Find the knot of a closed polygon.

    Args:
        polygon: (n, 3) vertices in general position: no four in a plane.
        rng: Turns the polygon before it is projected.
    """
    return smaller(polygon, rng)[0]


def smaller(polygon: Array, rng: np.random.Generator) -> tuple[Knot, Array]:
    """Return the knot of a closed polygon and the simplified polygon that shows it."""
    points = simplified(polygon)
    knot = _judged(points, rng)
    for k in range(40):
        if knot.verdict != "undecided":
            break
        points = simplified(tightened(points, (0.9, 0.4, 0.65)[k % 3]))
        knot = _judged(points, rng)
    return knot, points


def _judged(points: Array, rng: np.random.Generator) -> Knot:
    """Return the knot of a polygon without simplifying it."""
    if len(points) < MIN_STICKS:
        return UNKNOT
    places, signs = _fewest_crossings(points, rng)
    if len(signs) < 3:  # the trefoil knot has three
        return UNKNOT
    if len(signs) > 1200:  # elimination takes time by the cube of the number
        return Knot(verdict="undecided", determinant=None, crossings=len(signs))
    exact = len(signs) <= 300  # with more, modulo two primes only
    value = _determinant(places, signs) if exact else None
    knotted = (value is not None and value != 1) or not _is_unit(places, signs)
    return Knot(
        verdict="knotted" if knotted else "undecided", determinant=value, crossings=len(signs)
    )


# Closing ------------------------------------------------------------------------------------------


def closed_polygons(
    points: Array, rng: np.random.Generator, *, closed: bool = False
) -> list[Array]:
    """Return closed polygons of a chain, one for each choice of outward directions.

    Args:
        points: (n, 3) centres in order, about the origin.
        rng: Random shifts, and outward directions without a free one.
        closed: True if the last point is joined to the first one instead.

    Returns:
        (n + k, 3) each: the points, then k corners far outside by which the ends are joined.
    """
    moved = points + rng.uniform(-KNOT_JITTER, KNOT_JITTER, points.shape)
    if closed or float(np.linalg.norm(points[-1] - points[0])) < 1.05:  # one pitch, and rounding
        return [moved]
    first, last = _ways_out(points, 0, rng), _ways_out(points, len(points) - 1, rng)
    return [
        _closed(moved, first[k % len(first)], last[k % len(last)])
        for k in range(max(len(first), len(last)))
    ]


def _ways_out(points: Array, end: int, rng: np.random.Generator) -> list[Array]:
    """Return (3,) outward directions of an end: a free one alone, else several."""
    offsets = np.delete(points, end, axis=0) - points[end]
    outward = points[end] / max(float(np.linalg.norm(points[end])), 1e-9)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    axes = axes[np.argsort(-(axes @ outward), kind="stable")]
    for axis in axes:
        along = offsets @ axis
        distances = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
        if not ((along > 0.0) & (distances < 0.75)).any():  # a clear way out
            return [axis]
    tries = [outward, *rng.normal(size=(4, 3))]
    return [way / max(float(np.linalg.norm(way)), 1e-9) for way in tries]


def _closed(points: Array, first_way: Array, last_way: Array) -> Array:
    """Return a chain with both ends drawn straight out and joined around it."""
    radius = 4.0 * (float(np.linalg.norm(points, axis=1).max()) + 1.0)  # outside of the chain
    # An odd tilt keeps the far corners out of the planes of the lattice.
    first = points[0] + radius * _tilted(first_way, 0.01)
    last = points[-1] + radius * _tilted(last_way, 0.017)
    corners = [last, first]
    if first_way @ last_way < -0.2:
        sideways = np.cross(first_way, np.eye(3)[int(np.argmin(np.abs(first_way)))])
        sideways = sideways / float(np.linalg.norm(sideways))
        corners.insert(1, radius * _tilted(sideways.astype(np.float64), 0.013))
    return np.concatenate([points, np.array(corners)])


def _tilted(way: Array, angle: float) -> Array:
    """Return a direction that is tilted by a small angle."""
    return way + angle * 0.1 * np.array([0.37, -0.61, 0.53])


# Diagrams -----------------------------------------------------------------------------------------


def _fewest_crossings(points: Array, rng: np.random.Generator) -> tuple[Array, Ints]:
    """Return the diagram with the fewest crossings among random directions of view."""
    return best_view(points, rng)[1:]


def best_view(points: Array, rng: np.random.Generator) -> tuple[Array, Array, Ints]:
    """Return the random direction of view with the fewest crossings of a polygon.

    Returns:
        (3,) direction towards the viewer; ``places`` and ``signs`` of
        ``planner/core/knots.cpp``.
    """
    best: tuple[Array, Array, Ints] | None = None
    for _ in range(24 if len(points) < 500 else 2):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        if np.linalg.det(turn) < 0:
            turn[:, 0] *= -1
        places, signs = seen_crossings(np.ascontiguousarray(points @ turn))
        if best is None or len(signs) < len(best[2]):
            best = (turn[:, 2].copy(), places, signs)
    assert best is not None
    return best


def _alexander(places: Array, signs: Ints, at: int) -> Ints:
    """Return the Alexander matrix of a diagram at a number, less one row and one column."""
    n = len(signs)
    # An arc begins where a strand comes out from below another one.
    under = np.sort(places[:, 1])
    over = np.searchsorted(under, places[:, 0]) % n
    arrives = np.searchsorted(under, places[:, 1])
    leaves = (arrives + 1) % n
    matrix = np.zeros((n, n), dtype=np.int64)
    rows = np.arange(n)
    np.add.at(matrix, (rows, over), 1 - at)
    np.add.at(matrix, (rows, arrives), np.where(signs > 0, at, -1))
    np.add.at(matrix, (rows, leaves), np.where(signs > 0, -1, at))
    return matrix[:-1, :-1].copy()


def _determinant(places: Array, signs: Ints) -> int:
    """Compute |Δ(−1)| exactly from remainders, as many as Hadamard's bound requires."""
    matrix = _alexander(places, signs, -1)
    # A row holds 2, −1 and −1; both signs have to be told apart.
    needed = ceil(len(matrix) * log2(6.0) / 2.0) + 2
    primes = _primes(ceil(needed / 30.0))
    modulus = prod(primes)
    value = 0
    for prime in primes:
        cofactor = modulus // prime
        value += int(determinant_modulo(matrix, prime)) * cofactor * pow(cofactor, -1, prime)
    value %= modulus
    return min(value, modulus - value)


def _is_unit(places: Array, signs: Ints) -> bool:
    """Return True if the polynomial may be ±tᵏ like the unknot's; False proves a knot."""
    for prime in _primes(2):
        if int(determinant_modulo(_alexander(places, signs, -1), prime)) not in (1, prime - 1):
            return False
        value = int(determinant_modulo(_alexander(places, signs, SECOND_EVALUATION_POINT), prime))
        power, units = 1, set[int]()
        for _ in range(len(signs) + 1):
            units |= {power, prime - power}
            power = power * SECOND_EVALUATION_POINT % prime
        if value not in units:
            return False
    return True


def _primes(count: int) -> list[int]:
    """Return the largest primes below 2^31."""
    primes: list[int] = []
    number = 2**31 - 1
    while len(primes) < count:
        if _is_prime(number):
            primes.append(number)
        number -= 2
    return primes


def _is_prime(number: int) -> bool:
    """Return True if an odd number below 2³¹ is prime: Miller and Rabin's test, exact there."""
    odd, halvings = number - 1, 0
    while odd % 2 == 0:
        odd, halvings = odd // 2, halvings + 1
    for base in (2, 3, 5, 7):
        value = pow(base, odd, number)
        if value in (1, number - 1):
            continue
        for _ in range(halvings - 1):
            value = value * value % number
            if value == number - 1:
                break
        else:
            return False
    return True
