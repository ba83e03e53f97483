from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import InputError
from planner.shapes.shape import Shape

COORDINATES = st.integers(-1000, 1000)
CELLS = st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=1, max_size=40)


@given(CELLS, st.randoms(use_true_random=False))
def test_shape_has_its_cells_in_one_order(cells: list[tuple[int, ...]], rng) -> None:  # type: ignore[no-untyped-def]
    shape = Shape.from_cells(cells)
    assert shape.cells.tolist() == sorted([list(c) for c in set(cells)])
    shuffled = [*cells, cells[0]]
    rng.shuffle(shuffled)
    np.testing.assert_array_equal(Shape.from_cells(shuffled).cells, shape.cells)
    assert len(shape) == len(set(cells))


def test_cells_of_a_shape_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Shape.from_cells([[0, 0, 0]]).cells[0, 0] = 1


@pytest.mark.parametrize(
    ("cells", "code", "where"),
    [
        ([], "empty", None),
        (np.zeros((0, 3)), "empty", None),
        ([[0, 0]], "not-cells", None),
        ([["a", "b", "c"]], "not-cells", None),
        ([[True, False, True]], "not-cells", None),
        ([[0, 0, 0], [0, 0.5, 0]], "not-whole", "cell 1"),
        ([[0, 0, 0], [0, np.nan, 0]], "not-finite", "cell 1"),
        ([[0, 0, 1e300]], "too-far", "cell 0"),
    ],
)
def test_invalid_cells_are_refused(cells: object, code: str, where: str | None) -> None:
    with pytest.raises(InputError) as refusal:
        Shape.from_cells(cells)  # type: ignore[arg-type]
    assert (refusal.value.code, refusal.value.where) == (code, where)


@pytest.mark.parametrize("pitch_m", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_impossible_pitch_is_refused(pitch_m: float) -> None:
    with pytest.raises(InputError, match="pitch"):
        Shape.from_cells([[0, 0, 0]], pitch_m=pitch_m)
