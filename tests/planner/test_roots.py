import math
from collections.abc import Callable

import pytest
from scipy.optimize import brentq

from foldback.planner.roots import find_root


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 1e-12])
def test_roots_have_the_bits_of_scipys(tolerance: float) -> None:
    functions: tuple[Callable[[float], float], ...] = (
        math.cos,
        lambda x: math.exp(-x) - 0.3,
        lambda x: (x - 1.5) ** 5,
        lambda x: 1.0 - x**3,
        lambda x: 2.0 if x < 0.7 else -1.0 - x,
        lambda x: 3.0 - x,
        lambda x: x,
    )
    for function in functions:
        root = find_root(function, 0.0, 3.0, tolerance=tolerance)
        assert root == brentq(function, 0.0, 3.0, xtol=tolerance)


def test_a_function_with_one_sign_has_no_root() -> None:
    with pytest.raises(ValueError, match="different signs"):
        find_root(math.exp, 0.0, 1.0, tolerance=1e-9)
