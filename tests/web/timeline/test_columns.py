import dataclasses

import numpy as np
import pytest

from foldback.planner.motion.motion import Motion
from foldback.web.timeline.columns import encode
from foldback.web.timeline.window_columns import (
    PLANE_COLUMNS,
    SENT_ANGLE_STEP_RAD,
    SHORT_COLUMNS,
    window_columns,
)
from tests.planner import peels
from tests.web import long_folds
from tests.web.timeline.decoding import decode, windows_of


def test_columns_are_decoded_as_encoded() -> None:
    columns = {
        "doubles": np.linspace(0, 1, 7).reshape(7, 1),
        "singles": np.arange(6, dtype=np.float32).reshape(2, 3),
        "bytes": np.array([1, 2, 3], np.uint8),
        "signed": np.array([-5, 5], np.int32),
    }
    header, decoded_columns = decode(encode({"name": "a ⟶ b", "n": 3}, columns))
    assert header == {"name": "a ⟶ b", "n": 3}
    assert decoded_columns.keys() == columns.keys()
    for name, values in columns.items():
        assert decoded_columns[name].dtype == values.dtype
        assert np.array_equal(decoded_columns[name], values)


def test_arrays_are_aligned_to_8_bytes() -> None:
    message = encode({"x": "y" * 5}, {"a": np.zeros(3, np.uint8), "b": np.ones(2)})
    start = 4 + int.from_bytes(message[:4], "little")
    assert start % 8 == 0
    assert np.frombuffer(message, "<f8", 2, start + 8).tolist() == [1.0, 1.0]


def test_steps_are_precise_to_half_a_step_and_save_space() -> None:
    angles = np.cumsum(np.random.default_rng(1).normal(0, 0.02, (200, 31)), axis=0)
    _, decoded_columns = decode(encode({}, {"a": angles}, steps={"a": 1e-5}))
    assert np.abs(decoded_columns["a"] - angles).max() <= 0.5e-5 + 1e-7 * np.abs(angles).max()
    slow = np.sin(np.linspace(0, 3, 500))[:, None] * np.linspace(0, 1.5, 40)
    plain = encode({}, {"a": slow.astype("<f4")})
    assert len(encode({}, {"a": slow}, steps={"a": 2.0**-20})) < len(plain) / 3


def test_short_numbers_keep_nan() -> None:
    values = np.array([[np.nan, 0.0, 1.0], [-2.7e-5, 3.14159, 1e-30]])
    _, decoded_columns = decode(encode({}, {"a": values}, short=frozenset({"a"})))
    assert np.allclose(decoded_columns["a"], values, rtol=1 / 256, equal_nan=True)


def test_empty_columns_are_encoded() -> None:
    _, decoded_columns = decode(encode({}, {"a": np.zeros((0, 4))}, steps={"a": 0.1}))
    assert decoded_columns["a"].shape == (0, 4)


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e9])
def test_values_outside_the_steps_are_sent_plainly(odd: float) -> None:
    angles = np.full((3, 2), 0.25)
    angles[1, 1] = odd
    _, decoded_columns = decode(encode({}, {"a": angles}, steps={"a": 2.0**-20}))
    assert np.array_equal(decoded_columns["a"], angles.astype("<f4"), equal_nan=True)


def test_long_integers_are_refused() -> None:
    with pytest.raises(TypeError, match="<i8"):
        encode({}, {"a": np.zeros(2, np.int64)})


CHAIN = peels.snake((4, 4, 6))


def round_trip(windows: Motion) -> Motion:
    message = encode(
        {},
        window_columns(windows, CHAIN.folded_rad),
        planes=PLANE_COLUMNS,
        short=SHORT_COLUMNS,
    )
    return windows_of(decode(message)[1], CHAIN.folded_rad)


def assert_same(motion: Motion, windows: Motion) -> None:
    for name in ("time_s", "phase", "first", "offsets", "anchor_position", "anchor_wxyz"):
        assert np.array_equal(getattr(motion, name), getattr(windows, name)), name
    assert (
        np.abs(motion.angles_rad - windows.angles_rad).max(initial=0.0)
        <= 0.51 * SENT_ANGLE_STEP_RAD
    )
    assert np.allclose(motion.errors, windows.errors, rtol=1 / 256, atol=0.0, equal_nan=True)
    assert np.array_equal(motion.recorded, windows.recorded)


@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_windows_are_decoded_as_encoded(off: float) -> None:
    windows = long_folds.fold(CHAIN, width=20, step=1.3, base_moves=True, error_rad=off)
    for window in (windows, windows[::40], windows[:0]):
        assert_same(round_trip(window), window)


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
