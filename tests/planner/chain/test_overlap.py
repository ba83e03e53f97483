from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.chain.overlap import first_close_pair


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.floats(0.5, 8.0))
def test_first_close_pair_agrees_with_all_distances(seed: int, count: int, size: float) -> None:
    points = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1)
    np.fill_diagonal(distances, np.inf)
    pair = first_close_pair(points, 0.98)
    if pair is None:
        assert distances.min() >= 0.98
    else:
        i, j = pair
        assert i < j
        assert distances[i, j] < 0.98


def test_thousands_of_points_in_one_place_need_little_memory() -> None:
    assert first_close_pair(np.zeros((50_000, 3)), 0.98) is not None
