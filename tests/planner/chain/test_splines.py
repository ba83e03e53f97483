from typing import Any

import numpy as np
import pytest
from scipy import interpolate

from foldback.planner.chain.splines import BSpline, CubicSpline


@pytest.mark.parametrize("degree", [1, 3])
def test_b_spline_has_the_bits_of_scipys(degree: int) -> None:
    random = np.random.default_rng(degree)
    inner = np.sort(np.concatenate([random.uniform(size=20), [0.5, 0.5]]))  # a knot twice
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    controls = random.normal(size=(len(knots) - degree - 1, 7))
    at = np.concatenate([random.uniform(-0.1, 1.1, 200), inner, [0.0, 1.0]])
    curve, expected = BSpline(knots, controls), interpolate.BSpline(knots, controls, degree)
    np.testing.assert_array_equal(curve(at), expected(at))
    if degree == 3:
        np.testing.assert_array_equal(curve.derivative()(at), expected.derivative()(at))
        curve, expected = curve.derivative().derivative(), expected.derivative(2)
        np.testing.assert_array_equal(curve(at), expected(at))
    assert curve(0.3).shape == (7,)


@pytest.mark.parametrize("at_rest", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("shape", [(), (5,)])
def test_cubic_spline_has_the_bits_of_scipys(
    at_rest: tuple[bool, bool], shape: tuple[int, ...]
) -> None:
    random = np.random.default_rng(7)
    times = np.cumsum(random.uniform(0.02, 0.03, 40))
    values = random.normal(size=(40, *shape))
    start, end = (np.zeros(shape) if rests else None for rests in at_rest)
    curve = CubicSpline.through(times, values, start_rates=start, end_rates=end)
    ends: Any = tuple((1, np.zeros(shape)) if rests else "not-a-knot" for rests in at_rest)
    expected = interpolate.CubicSpline(times, values, bc_type=ends)
    at = np.concatenate([times, random.uniform(times[0] - 0.1, times[-1] + 0.1, 100)])
    for order in range(3):
        np.testing.assert_array_equal(curve(at, order), expected(at, order))


def test_cubic_spline_through_very_uneven_times_is_scipys() -> None:
    # SciPy exchanges rows of these equations.
    random = np.random.default_rng(8)
    times = np.cumsum(10.0 ** random.uniform(-4.0, 1.0, 40))
    values = np.cumsum(random.normal(size=(40, 2)), axis=0)
    curve, expected = CubicSpline.through(times, values), interpolate.CubicSpline(times, values)
    at = random.uniform(times[0], times[-1], 100)
    np.testing.assert_allclose(curve(at), expected(at), rtol=1e-9)
