from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.pathfinding.snake import is_box, snake_path
from planner.shapes.shape import Shape

SIDES = st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 6))


@given(sides=SIDES, axes=st.sampled_from(list(permutations((0, 1, 2)))))
def test_snake_visits_every_cell_of_a_box(
    sides: tuple[int, int, int], axes: tuple[int, int, int]
) -> None:
    path = snake_path(sides, axes=axes)
    assert (np.abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()
    assert np.array_equal(np.unique(path, axis=0), np.argwhere(np.ones(sides, dtype=bool)))
    if sides[axes[0]] > 1:
        assert (path[1] - path[0]).tolist() == np.eye(3)[axes[0]].tolist()


@pytest.mark.parametrize(("hole", "box"), [(None, True), ((1, 1, 1), False), ((0, 0, 0), False)])
def test_is_box(hole: tuple[int, int, int] | None, box: bool) -> None:
    cells = [tuple(c) for c in (snake_path((3, 3, 3)) + 7).tolist()]
    if hole is not None:
        cells.remove(tuple(7 + v for v in hole))
    assert is_box(Shape.from_cells(cells)) is box
