"""Time-optimal laws along a path with bounds on every hinge, compiled.

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

from planner.kernels import INNER, KERNEL

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MOST_CUTS = 100
ROUNDING = 1e-12
LEAST_LEFT = 0.05
"""Share of a torque's bound that is left for ü, at least."""
STEEP = 1e-7
"""A row with |b| below this share of |a| bounds x alone; its line is too steep to intersect."""


@njit(**INNER)
def _slopes(slopes: Array, left: int, right: int, part: Array, start: Array, end: Array) -> None:
    """Writes q' at both knots of a cell."""
    for j in range(start.size):
        turn = slopes[right, j] - slopes[left, j]
        start[j] = slopes[left, j] + part[0] * turn
        end[j] = slopes[left, j] + part[1] * turn


@njit(**KERNEL)
def fastest_profile(
    slopes: Array,
    left: Indices,
    right: Indices,
    parts: Array,
    lengths: Array,
    speed: float,
    acceleration: float,
) -> Array:
    """(N + 1,) largest ṡ² at the knots that the bounds allow, at rest at both ends.

    Args:
        slopes: (K, J) slopes q' between which those of each cell lie.
        left, right: (N,) which two.
        parts: (N, 2) how far it is from the left to the right one at both knots of a cell; q' is
            zero at one of them at most.
        lengths: (N,) of the cells, in s.
        speed: Bound of every |q̇|.
        acceleration: Bound of every |q̈|.
    """
    count = lengths.size
    start = np.empty(slopes.shape[1])
    end = np.empty(slopes.shape[1])
    # |q'| is largest at a knot, so this holds between knots too.
    ceiling = np.full(count + 1, np.inf)
    for k in range(count):
        _slopes(slopes, left[k], right[k], parts[k], start, end)
        steepest = 0.0
        for j in range(start.size):
            steepest = max(steepest, abs(start[j]), abs(end[j]))
        most = (speed / steepest) ** 2
        ceiling[k] = min(ceiling[k], most)
        ceiling[k + 1] = min(ceiling[k + 1], most)
    ceiling[0] = ceiling[count] = 0.0
    for k in range(count - 1, -1, -1):
        _slopes(slopes, left[k], right[k], parts[k], start, end)
        ceiling[k] = _controllable(start, end, lengths[k], acceleration, ceiling[k], ceiling[k + 1])
    x = np.zeros(count + 1)
    for k in range(count):
        _slopes(slopes, left[k], right[k], parts[k], start, end)
        high = _reach(start, end, lengths[k], acceleration, x[k])[2]
        x[k + 1] = max(0.0, min(high, ceiling[k + 1]))
    return x


@njit(**INNER)
def _reach(
    start: Array, end: Array, length: float, acceleration: float, x: float
) -> tuple[float, float, float, float, float]:
    """What x at a knot allows at the next: least and slope, most and slope; and the most x alone.

    Each hinge has a row |a x + b y| ≤ acceleration at either knot, y being the next x.
    """
    low, low_slope, high, high_slope, alone = -np.inf, 0.0, np.inf, 0.0, np.inf
    half = 0.5 / length
    for j in range(start.size):
        bend = (end[j] - start[j]) / length
        for knot in range(2):
            a = bend - half * start[j] if knot == 0 else -half * end[j]
            b = half * start[j] if knot == 0 else bend + half * end[j]
            if abs(b) <= STEEP * abs(a):
                if a != 0.0:
                    alone = min(alone, acceleration / abs(a))
                continue
            slope = -a / b
            most = acceleration / abs(b)
            if slope * x + most < high:
                high, high_slope = slope * x + most, slope
            if slope * x - most > low:
                low, low_slope = slope * x - most, slope
    return low, low_slope, high, high_slope, alone


@njit(**INNER)
def _controllable(
    start: Array, end: Array, length: float, acceleration: float, x: float, following: float
) -> float:
    """The largest of 0 … x from which 0 … ``following`` can be reached at the next knot.

    How much there is to choose from is a concave function of x, and not negative at 0: cutting
    along its tangents leads down to its root.
    """
    x = min(x, _reach(start, end, length, acceleration, 0.0)[4])
    for _ in range(MOST_CUTS):
        low, low_slope, high, high_slope, _ = _reach(start, end, length, acceleration, x)
        if low < 0.0:
            low, low_slope = 0.0, 0.0
        if high > following:
            high, high_slope = following, 0.0
        if high - low >= -ROUNDING * (x + following) or high_slope >= low_slope:
            break
        x = max(0.0, x - (high - low) / (high_slope - low_slope))
    return x


@njit(**KERNEL)
def torque_passes(a: Array, b: Array, ceiling: Array, step: float) -> Array:
    """(U,) z = u̇² at even places of a path along which the torques are τ = a ü + b u̇².

    It is never above the ceiling and 0 at both ends; ü = z' / 2 is what |τ| ≤ 1 leaves of it: a
    forward and a backward pass (Bobrow, Dubowsky, Gibson: Time-optimal control, 1985).

    Args:
        a, b: (U, J).
        ceiling: (U,).
        step: From one place to the next.
    """
    z = ceiling.copy()
    z[0] = z[-1] = 0.0
    last = len(z) - 1
    for forth in (True, False):
        for k in range(last):
            here, there = (k, k + 1) if forth else (last - k, last - k - 1)
            most = np.inf
            for j in range(a.shape[1]):
                left = max(1.0 - abs(b[here, j]) * z[here], LEAST_LEFT)
                most = min(most, left / max(abs(a[here, j]), 1e-12))
            z[there] = min(z[there], z[here] + 2.0 * most * step)
    return z
