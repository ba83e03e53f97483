"""Splines: piecewise polynomials through or near points.

The formulas are SciPy's, and so are the results, but for the last bits where SciPy exchanges rows
of equations. SciPy itself is not used because importing ``scipy.interpolate`` takes half a second
of the processor: more than the explosion of 160 modules.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.core import solve_tridiagonal, spline_points


@dataclass(frozen=True, slots=True, eq=False)
class BSpline:
    """B-spline of any degree, continued beyond its ends by its first and last polynomial.

    Attributes:
        knots: (C + degree + 1,) knots, not falling.
        controls: (C, J) control points.
    """

    knots: Array
    controls: Array

    def __call__(self, at: Array | float) -> Array:
        """Return the (…, J) points of the curve at (…) parameters."""
        parameters = np.asarray(at, dtype=np.float64)
        points = spline_points(self.knots, self.controls, parameters.ravel())
        return points.reshape(*parameters.shape, self.controls.shape[1])

    def derivative(self) -> BSpline:
        """Return the derivative, a B-spline of one degree less."""
        knots = self.knots
        degree = len(knots) - len(self.controls) - 1
        spans = (knots[degree + 1 : -1] - knots[1 : -degree - 1])[:, None]
        controls = np.diff(self.controls, axis=0) * degree / spans
        return BSpline(knots[1:-1], controls)


@dataclass(frozen=True, slots=True, eq=False)
class CubicSpline:
    """Cubic polynomials through points, with continuous second derivatives.

    Attributes:
        times: (F,) increasing times.
        coefficients: (4, F - 1, …) coefficients of 1, s, s² and s³, with s the time since the
            start of each interval.
    """

    times: Array
    coefficients: Array

    @classmethod
    def through(
        cls,
        times: Array,
        values: Array,
        *,
        start_rates: Array | None = None,
        end_rates: Array | None = None,
    ) -> CubicSpline:
        """Return the spline through at least four points.

        Args:
            times: (F,) increasing times.
            values: (F, …) values at these times.
            start_rates: (…) rates at the first time; None if the first two intervals are to have
                the same polynomial ("not a knot").
            end_rates: The same at the last time.
        """
        values = np.asarray(values, dtype=np.float64)
        steps = np.diff(times)
        spans = steps.reshape(-1, *[1] * (values.ndim - 1))
        slopes = np.diff(values, axis=0) / spans
        # Row i of the equations of the rates is lower[i], diagonal[i], upper[i].
        lower, upper = np.zeros(len(times)), np.zeros(len(times))
        lower[1:-1], upper[1:-1] = steps[1:], steps[:-1]
        diagonal = np.ones(len(times))
        diagonal[1:-1] = 2 * (steps[:-1] + steps[1:])
        right = np.empty_like(values)
        right[1:-1] = 3 * (spans[1:] * slopes[:-1] + spans[:-1] * slopes[1:])
        if start_rates is not None:
            right[0] = start_rates
        else:
            diagonal[0], upper[0] = steps[1], times[2] - times[0]
            right[0] = (
                (spans[0] + 2 * upper[0]) * spans[1] * slopes[0] + spans[0] ** 2 * slopes[1]
            ) / upper[0]
        if end_rates is not None:
            right[-1] = end_rates
        else:
            diagonal[-1], lower[-1] = steps[-2], times[-1] - times[-3]
            right[-1] = (
                spans[-1] ** 2 * slopes[-2] + (2 * lower[-1] + spans[-1]) * spans[-2] * slopes[-1]
            ) / lower[-1]
        rates = solve_tridiagonal(lower, diagonal, upper, right.reshape(len(times), -1))
        rates = rates.reshape(right.shape)
        bends = (rates[:-1] + rates[1:] - 2 * slopes) / spans
        coefficients = [
            values[:-1],
            rates[:-1],
            (slopes - rates[:-1]) / spans - bends,
            bends / spans,
        ]
        return cls(times, np.stack(coefficients))

    def __call__(self, at: Array, order: int = 0) -> Array:
        """Return the (K, …) derivatives of an order at (K,) times; order 0 is the curve itself."""
        interval = np.searchsorted(self.times, at, "right") - 1
        interval = np.clip(interval, 0, len(self.times) - 2)
        since = (at - self.times[interval]).reshape(-1, *[1] * (self.coefficients.ndim - 2))
        power, sums = np.ones_like(since), np.zeros((len(at), *self.coefficients.shape[2:]))
        for exponent in range(order, 4):
            factor = float(np.prod(np.arange(exponent - order + 1, exponent + 1)))
            sums += self.coefficients[exponent][interval] * power * factor
            power = power * since
        return sums
