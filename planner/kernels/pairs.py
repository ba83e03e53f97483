"""Pairs of near modules, the repulsion between them and how fast they may move, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.kinematics import Vector, cross, vector
from foldback.planner.kernels.module import ModuleStates

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

MIN_GRID_POINTS = 1000
"""Number of points from which on near pairs are searched in a hashed grid, in time linear in the
points; for fewer, a walk along the chain is faster. Measured."""
MIN_REPULSION_SQUARE = 1e-6
"""Squared distance of two modules in pitches² below which their repulsion grows no more, so that it
stays finite if both centres coincide."""


class PairLimits(NamedTuple):
    """Allowed displacements of two modules relative to each other in one step, in pitches.

    Attributes:
        radius: Radius of both modules; beyond twice that, they cannot touch.
        approach: By how much they may come nearer.
        slide: By how much they may slide along each other.
    """

    radius: float
    approach: float
    slide: float


@njit(**INNER)
def _hash(x: int, y: int, z: int, mask: int) -> int:
    """Return the slot of a cell in a table of ``mask`` + 1 slots."""
    return (x * 73856093 ^ y * 19349663 ^ z * 83492791) & mask


@njit(**INNER, inline="always")  # called, it doubles the time of near_pairs
def append_pair(pairs: Pairs, count: int, i: int, j: int) -> Pairs:
    """Write a pair behind ``count`` others, and return the array: a larger one if it was full."""
    if count == pairs.shape[0]:
        larger = np.empty((2 * count, 2), dtype=np.int64)
        for k in range(count):
            larger[k, 0] = pairs[k, 0]
            larger[k, 1] = pairs[k, 1]
        pairs = larger
    pairs[count, 0] = i
    pairs[count, 1] = j
    return pairs


@njit(**KERNEL)
def near_pairs(points: Array, cutoff: float, apart: int) -> Pairs:
    """Return pairs (i, j), i < j, closer than ``cutoff`` and at least ``apart`` links apart.

    Consecutive points must be at most 1 apart. Long chains are sorted into a hashed grid of cells
    as wide as the cutoff: the cost is linear in the points.

    Args:
        points: (n, 3) positions, in pitches.
        cutoff: Largest distance, in pitches.
        apart: Smallest j − i.

    Returns:
        (P, 2) indices, ordered by i.
    """
    if points.shape[0] < MIN_GRID_POINTS:
        return _near_pairs_along(points, cutoff, apart)
    return _near_pairs_in_grid(points, cutoff, apart)


@njit(**INNER)
def _near_pairs_along(points: Array, cutoff: float, apart: int) -> Pairs:
    """Return near pairs by a walk along the chain that skips what is too far, see above."""
    n = points.shape[0]
    pairs = np.empty((max(16, 8 * n), 2), dtype=np.int64)
    count = 0
    limit = cutoff * cutoff
    for i in range(n):
        j = i + apart
        while j < n:
            dx = points[i, 0] - points[j, 0]
            dy = points[i, 1] - points[j, 1]
            dz = points[i, 2] - points[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if square < limit:
                pairs = append_pair(pairs, count, i, j)
                count += 1
                j += 1
            else:
                # Consecutive points are at most one pitch apart. So a point that is k pitches
                # beyond the cutoff has k followers that are too far as well. A distance that is
                # not finite allows no such conclusion, and has no value as an integer.
                j += 1
                if square < 1e18:  # else diverged
                    j += int(np.sqrt(square) - cutoff)
    return pairs[:count].copy()


@njit(**INNER)
def _near_pairs_in_grid(points: Array, cutoff: float, apart: int) -> Pairs:
    """Return near pairs from a hashed grid of cells, each of them a list of points, see above."""
    n = points.shape[0]
    pairs = np.empty((max(16, 8 * n), 2), dtype=np.int64)
    count = 0
    limit = cutoff * cutoff
    size = 16
    while size < 2 * n:
        size *= 2
    mask = size - 1
    head = np.full(size, -1, dtype=np.int64)
    following = np.empty(n, dtype=np.int64)
    cells = np.empty((n, 3), dtype=np.int64)
    for i in range(n):
        for c in range(3):
            cells[i, c] = np.int64(np.floor(points[i, c] / cutoff))
    for i in range(n - 1, -1, -1):
        slot = _hash(cells[i, 0], cells[i, 1], cells[i, 2], mask)
        following[i] = head[slot]
        head[slot] = i
    for i in range(n):
        for ox in range(-1, 2):
            for oy in range(-1, 2):
                for oz in range(-1, 2):
                    cx = cells[i, 0] + ox
                    cy = cells[i, 1] + oy
                    cz = cells[i, 2] + oz
                    j = head[_hash(cx, cy, cz, mask)]
                    while j >= 0:
                        if (
                            j >= i + apart
                            and cells[j, 0] == cx
                            and cells[j, 1] == cy
                            and cells[j, 2] == cz
                        ):
                            dx = points[i, 0] - points[j, 0]
                            dy = points[i, 1] - points[j, 1]
                            dz = points[i, 2] - points[j, 2]
                            if dx * dx + dy * dy + dz * dz < limit:
                                pairs = append_pair(pairs, count, i, int(j))
                                count += 1
                        j = following[j]
    return pairs[:count].copy()


@njit(**KERNEL)
def repulsion(points: Array, pairs: Pairs, gain: float, out: Array) -> None:
    """Add the repulsion of near modules, gain / distance², to (n, 3) forces: the paper's eq. 3.

    Args:
        points: (n, 3) centres of the modules.
        pairs: (P, 2) near pairs.
        gain: γ of the equation.
        out: (n, 3) forces, changed.
    """
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        dx = points[i, 0] - points[j, 0]
        dy = points[i, 1] - points[j, 1]
        dz = points[i, 2] - points[j, 2]
        square = max(dx * dx + dy * dy + dz * dz, MIN_REPULSION_SQUARE)
        scale = gain / (square * np.sqrt(square))
        out[i, 0] += scale * dx
        out[i, 1] += scale * dy
        out[i, 2] += scale * dz
        out[j, 0] -= scale * dx
        out[j, 1] -= scale * dy
        out[j, 2] -= scale * dz


@njit(**INNER)
def inverse_step_limit(
    gap: Vector, velocity: Vector, surface_speed: float, limits: PairLimits
) -> float:
    """Return 1/Δt_max in 1/s of a pair: the largest ratio of a speed to its displacement per step.

    A pair that cannot touch may approach by half of its clearance more, and slide so.

    Args:
        gap: Vector from one centre to the other, in pitches.
        velocity: Velocity of the other centre relative to the one, in pitches per second.
        surface_speed: Speed of a surface point due to their relative rotation.
        limits: Displacements that are allowed in one step.
    """
    distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
    closing = -velocity[0] * gap[0] - velocity[1] * gap[1] - velocity[2] * gap[2]
    square = velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]
    closing = max(closing / max(distance, 1e-9), 0.0) + surface_speed
    clearance = max(distance - 2.0 * limits.radius, 0.0)
    return max(
        closing / (limits.approach + 0.5 * clearance),
        (np.sqrt(square) + surface_speed) / (limits.slide + 0.5 * clearance),
    )


@njit(**INNER)
def pair_inverse_step_limit(i: int, j: int, modules: ModuleStates, limits: PairLimits) -> float:
    """Return 1/Δt_max in 1/s of two modules, in a frame that turns as both do on average.

    A common rigid motion so contributes nothing.
    """
    points, omega = modules.positions, modules.angular_velocities
    gap = (
        points[j, 0] - points[i, 0],
        points[j, 1] - points[i, 1],
        points[j, 2] - points[i, 2],
    )
    mean = (
        0.5 * (omega[i, 0] + omega[j, 0]),
        0.5 * (omega[i, 1] + omega[j, 1]),
        0.5 * (omega[i, 2] + omega[j, 2]),
    )
    common = cross(mean, gap)
    velocity_a, velocity_b = vector(modules.velocities[i]), vector(modules.velocities[j])
    relative = (
        velocity_b[0] - velocity_a[0] - common[0],
        velocity_b[1] - velocity_a[1] - common[1],
        velocity_b[2] - velocity_a[2] - common[2],
    )
    rotation = 0.0
    for r in range(3):
        rotation += (omega[j, r] - omega[i, r]) ** 2
    return inverse_step_limit(gap, relative, limits.radius * np.sqrt(rotation), limits)


@njit(**KERNEL)
def max_inverse_step_limit(modules: ModuleStates, pairs: Pairs, limits: PairLimits) -> float:
    """Return the largest inverse step limit in 1/s of near pairs.

    Args:
        modules: Poses and velocities of all modules.
        pairs: (P, 2) near pairs.
        limits: Displacements that are allowed in one step.
    """
    largest = 0.0
    for k in range(pairs.shape[0]):
        largest = max(largest, pair_inverse_step_limit(pairs[k, 0], pairs[k, 1], modules, limits))
    return largest
