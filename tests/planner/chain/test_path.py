from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from planner.chain.path import MAX_COORDINATE, Path
from planner.errors import InputError
from tests.planner.lattice import walks


@given(walks())
def test_self_avoiding_walk_is_a_path(cells: NDArray[np.int64]) -> None:
    path = Path.from_cells(cells)
    np.testing.assert_array_equal(path.cells, cells)
    assert len(path) == len(cells)
    assert not path.cells.flags.writeable


@pytest.mark.parametrize(
    ("cells", "code", "where"),
    [
        ([], "not-cells", None),
        ([(0, 0, 0)], "too-few-cells", None),
        ([(0, 0), (1, 0), (2, 0)], "not-cells", None),
        ([("a", "b", "c")] * 3, "not-cells", None),
        ([(0, 0, 0), (1, 0, 0), (1, 1.5, 0)], "not-whole", "cell 2"),
        ([(0, 0, 0), (np.nan, 0, 0), (1, 1, 0)], "not-finite", "cell 1"),
        ([(0, 0, 0), (np.inf, 0, 0), (1, 1, 0)], "not-finite", "cell 1"),
        ([(MAX_COORDINATE + 1, 0, 0), (0, 0, 0), (1, 0, 0)], "too-far", "cell 0"),
        ([(0, 0, 0), (1, 0, 0), (0, 0, 0)], "repeated-cell", "cells 0 and 2"),
        ([(0, 0, 0), (1, 0, 0), (3, 0, 0)], "not-adjacent", "cells 1 and 2"),
        ([(0, 0, 0), (1, 1, 0), (2, 1, 0)], "not-adjacent", "cells 0 and 1"),
    ],
)
def test_invalid_paths_are_refused_with_their_place(
    cells: object, code: str, where: str | None
) -> None:
    with pytest.raises(InputError) as refusal:
        Path.from_cells(cells)  # type: ignore[arg-type]
    assert (refusal.value.code, refusal.value.where) == (code, where)


@pytest.mark.parametrize("pitch_m", [0.0, -1.0, float("nan"), 2000.0])
def test_pitch_out_of_range_is_refused(pitch_m: float) -> None:
    with pytest.raises(InputError) as refusal:
        Path.from_cells([(0, 0, 0), (1, 0, 0), (2, 0, 0)], pitch_m=pitch_m)
    assert refusal.value.code == "bad-pitch"
