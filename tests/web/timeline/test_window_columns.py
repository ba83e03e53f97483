import dataclasses

import numpy as np
import pytest

from planner.motion.motion import Motion
from tests.planner import peels
from tests.web import long_folds
from web.timeline.columns import decode, encode
from web.timeline.window_columns import (
    PLANE_COLUMNS,
    SENT_ANGLE_STEP_RAD,
    SINGLE_BYTE_COLUMNS,
    window_columns,
    windows_of,
)

CHAIN = peels.snake((4, 4, 6))


def round_trip(windows: Motion) -> Motion:
    message = encode(
        {},
        window_columns(windows, CHAIN.folded_rad),
        planes=PLANE_COLUMNS,
        short=SINGLE_BYTE_COLUMNS,
    )
    return windows_of(decode(message)[1], CHAIN.folded_rad)


def assert_same(found: Motion, windows: Motion) -> None:
    for name in ("time_s", "phase", "first", "offsets", "anchor_position", "anchor_wxyz"):
        assert np.array_equal(getattr(found, name), getattr(windows, name)), name
    assert (
        np.abs(found.angles_rad - windows.angles_rad).max(initial=0.0) <= 0.51 * SENT_ANGLE_STEP_RAD
    )
    assert np.allclose(found.errors, windows.errors, rtol=1 / 256, atol=0.0, equal_nan=True)
    assert np.array_equal(found.recorded, windows.recorded)


@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_windows_are_decoded_as_encoded(off: float) -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3, base_moves=True, error_rad=off)
    for some in (windows, windows[::40], windows[:0]):
        assert_same(round_trip(some), some)


@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_windows_anywhere_are_decoded_as_encoded(off: float) -> None:
    rng = np.random.default_rng(0)
    hinges = len(CHAIN.folded_rad)
    first = rng.integers(0, hinges + 1, 60)
    lengths = np.array([rng.integers(0, hinges + 1 - f) for f in first])
    windows = peels.windows_of(
        CHAIN, first.tolist(), [rng.uniform(-2.0, 2.0, length) for length in lengths]
    )
    if off:
        errors = rng.uniform(0.0, off, len(windows.angles_rad)).astype(np.float32)
        windows = dataclasses.replace(windows, errors_rad=errors)
    assert_same(round_trip(windows), windows)


def test_motion_that_was_not_simulated_has_no_error_columns() -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3, error_rad=1e-3)
    explosion, playback = windows[: len(windows) // 2], windows[len(windows) // 2 :]
    assert explosion.errors_rad is not None
    kinematic = dataclasses.replace(explosion, errors_rad=None)
    columns = window_columns(explosion, CHAIN.folded_rad)
    assert columns.keys() == window_columns(kinematic, CHAIN.folded_rad).keys()
    simulated = window_columns(playback, CHAIN.folded_rad)
    assert simulated.keys() - columns.keys() == {"errors_rad", "recorded"}
    assert simulated["recorded"].all()
