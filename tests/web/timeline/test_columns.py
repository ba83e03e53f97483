import numpy as np
import pytest

from web.timeline.columns import decode, encode


def test_columns_are_decoded_as_encoded() -> None:
    columns = {
        "doubles": np.linspace(0, 1, 7).reshape(7, 1),
        "singles": np.arange(6, dtype=np.float32).reshape(2, 3),
        "bytes": np.array([1, 2, 3], np.uint8),
        "signed": np.array([-5, 5], np.int32),
    }
    header, found = decode(encode({"name": "a ⟶ b", "n": 3}, columns))
    assert header == {"name": "a ⟶ b", "n": 3}
    assert found.keys() == columns.keys()
    for name, values in columns.items():
        assert found[name].dtype == values.dtype
        assert np.array_equal(found[name], values)


def test_arrays_are_aligned_to_8_bytes() -> None:
    message = encode({"x": "y" * 5}, {"a": np.zeros(3, np.uint8), "b": np.ones(2)})
    start = 4 + int.from_bytes(message[:4], "little")
    assert start % 8 == 0
    assert np.frombuffer(message, "<f8", 2, start + 8).tolist() == [1.0, 1.0]


def test_steps_are_precise_to_half_a_step_and_save_space() -> None:
    rng = np.random.default_rng(1)
    angles = np.cumsum(rng.normal(0, 0.02, (200, 31)), axis=0)
    _, found = decode(encode({}, {"a": angles}, steps={"a": 1e-5}))
    assert np.abs(found["a"] - angles).max() <= 0.5e-5 + 1e-7 * np.abs(angles).max()
    slow = np.sin(np.linspace(0, 3, 500))[:, None] * np.linspace(0, 1.5, 40)
    plain = encode({}, {"a": slow.astype("<f4")})
    assert len(encode({}, {"a": slow}, steps={"a": 2.0**-20})) < len(plain) / 3


def test_short_numbers_keep_nan() -> None:
    values = np.array([[np.nan, 0.0, 1.0], [-2.7e-5, 3.14159, 1e-30]])
    _, found = decode(encode({}, {"a": values}, short=frozenset({"a"})))
    assert np.allclose(found["a"], values, rtol=1 / 256, equal_nan=True)


def test_empty_columns_are_encoded() -> None:
    _, found = decode(encode({}, {"a": np.zeros((0, 4))}, steps={"a": 0.1}))
    assert found["a"].shape == (0, 4)


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e9])
def test_values_outside_the_steps_are_sent_plainly(odd: float) -> None:
    angles = np.full((3, 2), 0.25)
    angles[1, 1] = odd
    _, found = decode(encode({}, {"a": angles}, steps={"a": 2.0**-20}))
    assert np.array_equal(found["a"], angles.astype("<f4"), equal_nan=True)


def test_long_integers_are_refused() -> None:
    with pytest.raises(TypeError, match="<i8"):
        encode({}, {"a": np.zeros(2, np.int64)})
