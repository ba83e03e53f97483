"""Knots: known ones are recognised; the result is invariant under changes that preserve a knot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from foldback.planner.core import simplified, tightened
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.knots import Knot, knot_of, knot_of_polygon
from foldback.planner.pathfinding.knots import _determinant as exact_determinant
from foldback.planner.pathfinding.knots import _fewest_crossings as fewest_crossings
from foldback.planner.pathfinding.snake import snake_path
from tests.planner.chains import walk
from tests.planner.lattice import Ints

# An overhand knot: over- and undercrossings alternate.
OVERHAND = (
    (0, 0, 0), (6, 0, 0), (6, 4, 0), (2, 4, 0), (2, 4, 2), (2, -2, 2),
    (4, -2, 2), (4, -2, -2), (4, 2, -2), (4, 2, 2), (4, 6, 2),
)  # fmt: skip


def on_lattice(curve: NDArray[np.float64], scale: float) -> Ints:
    """Return a closed curve as a walk on the lattice that visits no cell twice."""
    cells = walk(np.round(scale * np.concatenate([curve, curve[:1]])).astype(np.int64))[:-1]
    assert len(np.unique(cells, axis=0)) == len(cells)
    return cells


def torus_winding(p: int, q: int) -> NDArray[np.float64]:
    """Return a curve with p turns around the axis and q turns around the ring."""
    u = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    rho = 3 + np.cos(q * u)
    return np.stack([rho * np.cos(p * u), rho * np.sin(p * u), np.sin(q * u)], axis=1)


def test_plain_paths_are_unknotted() -> None:
    for cells in (
        walk(((0, 0, 0), (9, 0, 0))),
        walk(((0, 0, 0), (4, 0, 0), (4, 5, 0))),
        walk(((0, 0, 0), (4, 0, 0), (4, 1, 0), (0, 1, 0))),
        walk(((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1))),
        snake_path((20, 20, 25)),
        np.array([(0, 0, 0), (1, 0, 0)]),
    ):
        assert knot_of(cells) == Knot(verdict="unknot", determinant=1, crossings=0), cells


@pytest.mark.parametrize("scale", [1, 5])
def test_overhand_knot_is_a_trefoil(scale: int) -> None:
    cells = walk(OVERHAND, scale)
    assert len(np.unique(cells, axis=0)) == len(cells)
    knot = knot_of(cells)
    assert knot == Knot(verdict="knotted", determinant=3, crossings=3)
    assert str(knot) == "knotted (determinant 3)"


@pytest.mark.parametrize(("p", "q", "expected"), [(2, 3, 3), (2, 5, 5), (4, 3, 3), (5, 1, 1)])
def test_windings_of_a_torus(p: int, q: int, expected: int) -> None:
    """Torus knots (2, q) have determinant q, and (3, 4) has 3; single windings have 1."""
    knot = knot_of(on_lattice(torus_winding(p, q), 9.0), closed=True)
    assert (knot.verdict, knot.determinant) == ("unknot" if expected == 1 else "knotted", expected)


def test_knot_of_determinant_one_is_found_by_its_polynomial() -> None:
    """The torus knot (3, 5) has |Δ(−1)| = 1, but Δ is not 1."""
    knot = knot_of(on_lattice(torus_winding(3, 5), 9.0), closed=True)
    assert (knot.verdict, knot.determinant) == ("knotted", 1)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), sticks=st.integers(6, 60))
def test_simplified_polygon_has_the_same_determinant(seed: int, sticks: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(sticks, 3))
    polygon = np.cumsum(steps - steps.mean(axis=0), axis=0)
    expected = raw_determinant(polygon, rng)
    smaller = simplified(polygon)
    assert len(smaller) <= len(polygon)
    for points in (smaller, tightened(polygon, 0.9), tightened(smaller, 0.5)):
        assert raw_determinant(points, rng) == expected
    knot = knot_of_polygon(polygon, rng)
    assert knot.determinant == expected
    assert (knot.verdict == "unknot") <= (expected == 1)


def raw_determinant(polygon: NDArray[np.float64], rng: np.random.Generator) -> int:
    places, signs = fewest_crossings(polygon, rng)
    return exact_determinant(places, signs) if len(signs) > 1 else 1


def test_path_that_ends_deep_inside_is_unknotted() -> None:
    """The path fills a layer, crosses its edge to another one, then spirals inwards."""
    above = snake_path((5, 5, 1))
    around = np.array([(5, 4, 0), (5, 4, -1), (5, 4, -2)])
    below = above[::-1] - (0, 0, 2)
    rounds = ((0, 0), (4, 0), (4, 4), (0, 4), (0, 1), (3, 1), (3, 3), (1, 3), (1, 2), (2, 2))
    spiral = walk(tuple((x, y, -1) for x, y in rounds))
    cells = np.concatenate([above, around, below, spiral])
    assert (np.abs(np.diff(cells, axis=0)).sum(axis=1) == 1).all()
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert knot_of(cells).verdict == "unknot"


def test_trefoil_cut_open_anywhere_is_a_trefoil() -> None:
    """The trefoil is recognised although the ends lie among other strands."""
    cells = on_lattice(torus_winding(2, 3), 3.0)
    for place in range(0, len(cells), 7):
        assert knot_of(np.roll(cells, place, axis=0)).determinant == 3


@pytest.mark.parametrize("bad", [[(0, 0)], [(0.0, 0.0, np.nan)], 3])
def test_invalid_cells_are_refused(bad: object) -> None:
    with pytest.raises(InputError, match="finite numbers in an array of shape \\(n, 3\\)"):
        knot_of(np.asarray(bad))
