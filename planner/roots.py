"""Roots of functions of one number."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable


def find_root(
    function: Callable[[float], float], low: float, high: float, *, tolerance: float
) -> float:
    """Return a root between two numbers at which a function has different signs.

    Brent's method (Algorithms for Minimization without Derivatives, 1973, chapter 4), step by step
    as in SciPy's ``brentq``, which takes half a second of the processor to import.

    Args:
        function: A continuous function.
        low, high: Ends of the interval.
        tolerance: Largest error of the root.

    Raises:
        ValueError: The function has the same sign at both ends.
    """
    last, x = low, high
    last_value, value = function(last), function(x)
    if last_value == 0.0:
        return last
    if value != 0.0 and (last_value < 0.0) == (value < 0.0):
        raise ValueError(f"got {last_value} and {value} at the ends, expected different signs.")
    # The root is between x and ``end``.
    end, end_value, last_step, step = 0.0, 0.0, 0.0, 0.0
    while True:
        if last_value != 0.0 and value != 0.0 and (last_value < 0.0) != (value < 0.0):
            end, end_value = last, last_value
            last_step = step = x - last
        if abs(end_value) < abs(value):
            last, x, end = x, end, x
            last_value, value, end_value = value, end_value, value
        delta = (tolerance + 4.0 * sys.float_info.epsilon * abs(x)) / 2.0
        half = (end - x) / 2.0
        if value == 0.0 or abs(half) < delta:
            return x
        interpolated = math.inf
        if abs(last_step) > delta and abs(value) < abs(last_value):
            if last == end:  # secant
                interpolated = -value * (x - last) / (value - last_value)
            else:  # inverse quadratic interpolation
                to_last = (last_value - value) / (last - x)
                to_end = (end_value - value) / (end - x)
                interpolated = (
                    -value
                    * (end_value * to_end - last_value * to_last)
                    / (to_end * to_last * (end_value - last_value))
                )
        if 2.0 * abs(interpolated) < min(abs(last_step), 3.0 * abs(half) - delta):
            last_step, step = step, interpolated
        else:
            last_step = step = half
        last, last_value = x, value
        x += step if abs(step) > delta else math.copysign(delta, half)
        value = function(x)
