"""Time-optimal scalings of motion along a path, with bounds of every hinge, compiled.

With bounds of speed and acceleration: reachability analysis over x = ṡ² at the knots of a grid
(Pham, Pham: A new approach to time-optimal path parameterization based on reachability analysis,
2018), with s̈ = (x₊ − x) / 2Δ constant from one knot to the next. The path is quadratic in s there,
so every acceleration q' s̈ + q'' ṡ² is linear in s: bounds that hold at both knots hold between
them. With bounds of torque: a forward and a backward pass.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@njit(**INNER)
def _write_slopes(
    slopes: Array, left: int, right: int, fractions: Array, start: Array, end: Array
) -> None:
    """Write (J,) slopes q' at both knots of a cell, interpolated between two given ones."""
    for j in range(start.size):
        change = slopes[right, j] - slopes[left, j]
        start[j] = slopes[left, j] + fractions[0] * change
        end[j] = slopes[left, j] + fractions[1] * change


@njit(**KERNEL)
def fastest_profile(
    slopes: Array,
    left: Indices,
    right: Indices,
    fractions: Array,
    lengths: Array,
    speed: float,
    acceleration: float,
) -> Array:
    """Return the (N + 1,) largest ṡ² at the knots that the bounds allow, at rest at both ends.

    Args:
        slopes: (K, J) slopes q' between which those of each cell lie.
        left, right: (N,) indices of these two.
        fractions: (N, 2) fraction from the left to the right one at both knots of a cell; q' is
            zero at one of them at most.
        lengths: (N,) lengths of the cells, in s.
        speed: Bound of every |q̇|, in rad/s.
        acceleration: Bound of every |q̈|, in rad/s².
    """
    count = lengths.size
    start = np.empty(slopes.shape[1])
    end = np.empty(slopes.shape[1])
    # |q'| is largest at a knot, so this holds between knots too.
    ceiling = np.full(count + 1, np.inf)
    for k in range(count):
        _write_slopes(slopes, left[k], right[k], fractions[k], start, end)
        steepest = 0.0
        for j in range(start.size):
            steepest = max(steepest, abs(start[j]), abs(end[j]))
        limit = (speed / steepest) ** 2
        ceiling[k] = min(ceiling[k], limit)
        ceiling[k + 1] = min(ceiling[k + 1], limit)
    ceiling[0] = ceiling[count] = 0.0
    for k in range(count - 1, -1, -1):
        _write_slopes(slopes, left[k], right[k], fractions[k], start, end)
        ceiling[k] = _controllable(start, end, lengths[k], acceleration, ceiling[k], ceiling[k + 1])
    x = np.zeros(count + 1)
    for k in range(count):
        _write_slopes(slopes, left[k], right[k], fractions[k], start, end)
        high = _next_range(start, end, lengths[k], acceleration, x[k])[2]
        x[k + 1] = max(0.0, min(high, ceiling[k + 1]))
    return x


@njit(**INNER)
def _next_range(
    start: Array, end: Array, length: float, acceleration: float, x: float
) -> tuple[float, float, float, float, float]:
    """Return the range of x₊ at the next knot that x at this one allows.

    Each hinge has a row |a x + b x₊| ≤ acceleration at either knot.

    Args:
        start, end: (J,) slopes q' at both knots.
        length: Length of the cell.
        acceleration: Bound of every |q̈|.
        x: ṡ² at this knot.

    Returns:
        Lower bound and its derivative by x, upper bound and its derivative by x, and the upper
        bound of x itself.
    """
    low, low_slope, high, high_slope, x_bound = -np.inf, 0.0, np.inf, 0.0, np.inf
    half = 0.5 / length
    for j in range(start.size):
        curvature = (end[j] - start[j]) / length
        for knot in range(2):
            a = curvature - half * start[j] if knot == 0 else -half * end[j]
            b = half * start[j] if knot == 0 else curvature + half * end[j]
            if abs(b) <= 1e-7 * abs(a):
                if a != 0.0:
                    x_bound = min(x_bound, acceleration / abs(a))
                continue
            slope = -a / b
            width = acceleration / abs(b)
            if slope * x + width < high:
                high, high_slope = slope * x + width, slope
            if slope * x - width > low:
                low, low_slope = slope * x - width, slope
    return low, low_slope, high, high_slope, x_bound


@njit(**INNER)
def _controllable(
    start: Array, end: Array, length: float, acceleration: float, x: float, x_next: float
) -> float:
    """Return the largest of 0 … x from which one of 0 … ``x_next`` can be reached.

    The size of the range at the next knot is a concave function of x, and not negative at 0: cuts
    along its tangents lead down to its root.
    """
    x = min(x, _next_range(start, end, length, acceleration, 0.0)[4])
    for _ in range(100):
        low, low_slope, high, high_slope, _ = _next_range(start, end, length, acceleration, x)
        if low < 0.0:
            low, low_slope = 0.0, 0.0
        if high > x_next:
            high, high_slope = x_next, 0.0
        if high - low >= -1e-12 * (x + x_next) or high_slope >= low_slope:
            break
        x = max(0.0, x - (high - low) / (high_slope - low_slope))
    return x


@njit(**KERNEL)
def torque_passes(a: Array, b: Array, ceiling: Array, step: float) -> Array:
    """Return (U,) z = u̇² at even steps of a path along which the torques are τ = a ü + b u̇².

    It is never above the ceiling and 0 at both ends; ü = z' / 2 is what |τ| ≤ 1 leaves of it: a
    forward and a backward pass (Bobrow, Dubowsky, Gibson: Time-optimal control, 1985).

    Args:
        a, b: (U, J) torques per ü and per u̇², as fractions of their bounds.
        ceiling: (U,) upper bound of z.
        step: Step of u.
    """
    z = ceiling.copy()
    z[0] = z[-1] = 0.0
    last = len(z) - 1
    for forward in (True, False):
        for k in range(last):
            i, following = (k, k + 1) if forward else (last - k, last - k - 1)
            limit = np.inf
            for j in range(a.shape[1]):
                # some torque is left even if centrifugal terms take it all
                available = max(1.0 - abs(b[i, j]) * z[i], 0.05)
                limit = min(limit, available / max(abs(a[i, j]), 1e-12))
            z[following] = min(z[following], z[i] + 2.0 * limit * step)
    return z
