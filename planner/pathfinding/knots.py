"""Knots: whether a folded chain is knotted when its ends are drawn out to infinity.

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
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.kernels.knots import crossings as seen_crossings
from planner.kernels.knots import determinant as determinant_modulo
from planner.kernels.knots import simplified, tightened

Array = NDArray[np.float64]
Verdict = Literal["unknot", "knotted", "undecided"]

JITTER: Final = 0.01
"""Pitches by which points move at random, out of each other's planes; strands are 0.5 apart."""
FAR: Final = 4.0
"""Factor of the chain's size: how far outside its ends are joined."""
STRAND_ROOM: Final = 0.75
"""Pitches between a ray and all other points when it leads out freely."""
TOUCHING: Final = 1.05
"""Pitches between the ends up to which they are joined directly."""
FEWEST_STICKS: Final = 6
"""Edges of the shortest polygon that can be knotted."""
FEWEST_CROSSINGS: Final = 3
"""Crossings of the simplest knot, the trefoil."""
ROUNDS: Final = 40
"""Times that a polygon is tightened while its verdict is ``undecided``."""
PROJECTIONS: Final = 24
"""Random directions of sight, of which the one with the fewest crossings is taken."""
LARGEST_DIAGRAM: Final = 1200
"""Crossings above which the verdict is ``undecided``: elimination takes time by their cube."""
LARGEST_EXACT: Final = 300
"""Crossings above which two primes decide, and the determinant is not told."""
ELSEWHERE: Final = 2
"""The Alexander polynomial is evaluated here too, not at −1 alone, where that of the torus knot of
3 and 5 is trivial."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Knot:
    """What is known of a chain's knot.

    Attributes:
        verdict: ``unknot`` and ``knotted`` are proved, ``undecided`` is neither.
        determinant: |Δ(−1)|: 1 for the unknot, 3 for a trefoil; None where it was not computed.
        crossings: Of the smallest diagram that was found.
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
    """Finds the knot of a chain.

    Ends that touch go out side by side, which is as if they were joined. Otherwise an end with a
    free way out goes that way, and one that has none is drawn out in several directions; where
    these don't agree the verdict is ``undecided``.

    Args:
        cells: (n, 3) centres in order, in pitches; neighbours in space a pitch apart or so.
        closed: Whether the last cell is joined to the first one instead.

    Returns:
        The knot; the same cells always give the same answer.

    Raises:
        InputError: ``not-cells`` when that is not what was given.
    """
    points = np.asarray(cells, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(
            "not-cells", f"got an array of shape {points.shape}, expected (n, 3) finite numbers."
        )
    if len(points) < (FEWEST_STICKS if closed else 3):
        return UNKNOT
    rng = np.random.default_rng(len(points))
    polygons = closed_polygons(points - points.mean(axis=0), rng, closed=closed)
    found = [knot_of_polygon(polygon, rng) for polygon in polygons]
    if len({(knot.verdict, knot.determinant) for knot in found}) == 1:
        return found[0]
    return Knot(verdict="undecided", determinant=None, crossings=min(k.crossings for k in found))


def knot_of_polygon(polygon: Array, rng: np.random.Generator) -> Knot:
    """Finds the knot of a closed polygon.

    Args:
        polygon: (n, 3) vertices in general position: no four in a plane.
        rng: Turns the polygon before it is projected.
    """
    return smaller(polygon, rng)[0]


def smaller(polygon: Array, rng: np.random.Generator) -> tuple[Knot, Array]:
    """The knot of a closed polygon as of ``knot_of_polygon``, and the smaller one that shows it."""
    points = simplified(polygon)
    knot = _judged(points, rng)
    for k in range(ROUNDS):
        if knot.verdict != "undecided":
            break
        points = simplified(tightened(points, (0.9, 0.4, 0.65)[k % 3]))
        knot = _judged(points, rng)
    return knot, points


def _judged(points: Array, rng: np.random.Generator) -> Knot:
    """The knot of a polygon as it is."""
    if len(points) < FEWEST_STICKS:
        return UNKNOT
    places, signs = _fewest_crossings(points, rng)
    if len(signs) < FEWEST_CROSSINGS:
        return UNKNOT
    if len(signs) > LARGEST_DIAGRAM:
        return Knot(verdict="undecided", determinant=None, crossings=len(signs))
    exact = len(signs) <= LARGEST_EXACT
    value = _determinant(places, signs) if exact else None
    knotted = (value is not None and value != 1) or not _is_unit(places, signs)
    return Knot(
        verdict="knotted" if knotted else "undecided", determinant=value, crossings=len(signs)
    )


# Closing ------------------------------------------------------------------------------------------


def closed_polygons(
    points: Array, rng: np.random.Generator, *, closed: bool = False
) -> list[Array]:
    """Closed polygons that are to be the same knot: one for each way in which ends are drawn out.

    Args:
        points: (n, 3) centres in order, about the origin.
        rng: Moves them a little, and chooses ways where none is free.
        closed: Whether the last point is joined to the first one instead.

    Returns:
        (n + k, 3) each: the points, then k corners far outside by which the ends are joined.
    """
    moved = points + rng.uniform(-JITTER, JITTER, points.shape)
    if closed or float(np.linalg.norm(points[-1] - points[0])) < TOUCHING:
        return [moved]
    first, last = _ways_out(points, 0, rng), _ways_out(points, len(points) - 1, rng)
    return [
        _closed(moved, first[k % len(first)], last[k % len(last)])
        for k in range(max(len(first), len(last)))
    ]


def _ways_out(points: Array, end: int, rng: np.random.Generator) -> list[Array]:
    """Directions (3,) in which an end is drawn out: a free one alone, else several."""
    others = np.delete(points, end, axis=0) - points[end]
    outward = points[end] / max(float(np.linalg.norm(points[end])), 1e-9)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    axes = axes[np.argsort(-(axes @ outward), kind="stable")]
    for axis in axes:
        along = others @ axis
        away = np.linalg.norm(others - along[:, None] * axis, axis=1)
        if not ((along > 0.0) & (away < STRAND_ROOM)).any():
            return [axis]
    tries = [outward, *rng.normal(size=(4, 3))]
    return [way / max(float(np.linalg.norm(way)), 1e-9) for way in tries]


def _closed(points: Array, first_way: Array, last_way: Array) -> Array:
    """A chain closed far outside: both ends drawn straight out, then joined around it."""
    radius = FAR * (float(np.linalg.norm(points, axis=1).max()) + 1.0)
    # An odd tilt keeps the far corners out of the planes of the lattice.
    first = points[0] + radius * _tilted(first_way, 0.01)
    last = points[-1] + radius * _tilted(last_way, 0.017)
    corners = [last, first]
    if first_way @ last_way < -0.2:
        aside = np.cross(first_way, np.eye(3)[int(np.argmin(np.abs(first_way)))])
        aside = aside / float(np.linalg.norm(aside))
        corners.insert(1, radius * _tilted(aside.astype(np.float64), 0.013))
    return np.concatenate([points, np.array(corners)])


def _tilted(way: Array, angle: float) -> Array:
    """A direction, a trifle off."""
    return way + angle * 0.1 * np.array([0.37, -0.61, 0.53])


# Diagrams -----------------------------------------------------------------------------------------


def _fewest_crossings(points: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
    """The diagram with the fewest crossings among some directions of sight."""
    return best_view(points, rng)[1:]


def best_view(points: Array, rng: np.random.Generator) -> tuple[Array, Array, NDArray[np.int64]]:
    """The direction of sight, among some, in which a closed polygon has the fewest crossings.

    Returns:
        (3,) the direction, pointing at who looks, with ``places`` and ``signs`` as of
        ``planner.kernels.knots.crossings``.
    """
    best: tuple[Array, Array, NDArray[np.int64]] | None = None
    for _ in range(PROJECTIONS if len(points) < 500 else 2):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        if np.linalg.det(turn) < 0:
            turn[:, 0] *= -1
        places, signs = seen_crossings(np.ascontiguousarray(points @ turn))
        if best is None or len(signs) < len(best[2]):
            best = (turn[:, 2].copy(), places, signs)
    assert best is not None
    return best


def _alexander(places: Array, signs: NDArray[np.int64], at: int) -> NDArray[np.int64]:
    """Alexander matrix of a diagram at a number, less one row and one column."""
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
    return matrix[:-1, :-1]


def _determinant(places: Array, signs: NDArray[np.int64]) -> int:
    """|Δ(−1)|, exact: from its remainders, as many as Hadamard's bound asks for."""
    matrix = _alexander(places, signs, -1)
    # A row holds 2, −1 and −1; both signs have to be told apart.
    needed = ceil(len(matrix) * log2(6.0) / 2.0) + 2
    primes = _primes(ceil(needed / 30.0))
    whole = prod(primes)
    value = 0
    for prime in primes:
        rest = whole // prime
        value += int(determinant_modulo(matrix, prime)) * rest * pow(rest, -1, prime)
    value %= whole
    return min(value, whole - value)


def _is_unit(places: Array, signs: NDArray[np.int64]) -> bool:
    """Whether the polynomial may be ±tᵏ, as the unknot's is; False proves a knot."""
    for prime in _primes(2):
        if int(determinant_modulo(_alexander(places, signs, -1), prime)) not in (1, prime - 1):
            return False
        value = int(determinant_modulo(_alexander(places, signs, ELSEWHERE), prime))
        power, units = 1, set[int]()
        for _ in range(len(signs) + 1):
            units |= {power, prime - power}
            power = power * ELSEWHERE % prime
        if value not in units:
            return False
    return True


def _primes(count: int) -> list[int]:
    """The largest primes below 2^31."""
    found: list[int] = []
    number = 2**31 - 1
    while len(found) < count:
        if _is_prime(number):
            found.append(number)
        number -= 2
    return found


def _is_prime(number: int) -> bool:
    """Miller and Rabin's test, which is exact for odd numbers of this size."""
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
