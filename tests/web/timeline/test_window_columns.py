from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planner.motion.windows import Windows
from tests.planner import peels
from tests.web import long_folds
from web.timeline.columns import decode, encode
from web.timeline.window_columns import ANGLE_STEP_RAD, PLANES, window_columns, windows_of

CHAIN = peels.snake((4, 4, 6))


def there_and_back(windows: Windows) -> Windows:
    message = encode({}, window_columns(windows, CHAIN.folded_rad), planes=PLANES)
    return windows_of(decode(message)[1], CHAIN.folded_rad)


def assert_same(found: Windows, windows: Windows) -> None:
    for name in ("time_s", "phase", "first", "offsets", "base_position", "base_wxyz"):
        assert np.array_equal(getattr(found, name), getattr(windows, name)), name
    assert np.abs(found.angles_rad - windows.angles_rad).max(initial=0.0) <= 0.51 * ANGLE_STEP_RAD


@pytest.mark.parametrize("stride", [1, 7, 40])
def test_what_is_told_is_what_was_recorded(stride: int) -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3, base_moves=True)
    assert_same(there_and_back(windows[::stride]), windows[::stride])


def test_windows_that_lie_anywhere() -> None:
    rng = np.random.default_rng(0)
    hinges = len(CHAIN.folded_rad)
    first = rng.integers(0, hinges + 1, 60)
    lengths = np.array([rng.integers(0, hinges + 1 - f) for f in first])
    windows = peels.windows_of(
        CHAIN, first.tolist(), [rng.uniform(-2.0, 2.0, length) for length in lengths]
    )
    assert_same(there_and_back(windows), windows)


def test_none_at_all() -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3)
    assert_same(there_and_back(windows[:0]), windows[:0])


def test_hinges_that_rest_cost_next_to_nothing() -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3)
    one = windows[np.full(200, 30)]
    still = encode({}, window_columns(one, CHAIN.folded_rad), planes=PLANES)
    moving = encode({}, window_columns(windows[:200], CHAIN.folded_rad), planes=PLANES)
    assert len(still) < len(moving) / 5
    assert_same(windows_of(decode(still)[1], CHAIN.folded_rad), dataclasses.replace(one))
