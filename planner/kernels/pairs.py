"""Pairs of modules that are near each other, and the forces between them, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

SKIP_BELOW = 1000
"""Points below which walking along the chain is faster than a grid."""
FARTHEST_SQUARE = 1e18
"""Squared distance in pitches² above which positions count as diverged."""


@njit(**INNER)
def _hash(x: int, y: int, z: int, mask: int) -> int:
    return (x * 73856093 ^ y * 19349663 ^ z * 83492791) & mask


@njit(**INNER, inline="always")  # called, it doubles the time of near_pairs
def append_pair(pairs: Pairs, count: int, i: int, j: int) -> Pairs:
    """Writes one pair behind ``count`` others, in a larger array when it is full."""
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
    """Pairs (i, j), i < j, closer than ``cutoff`` and at least ``apart`` apart along the chain.

    Consecutive points must be at most 1 apart. Long chains are sorted into a hashed grid of cells
    as wide as the cutoff: cost grows linearly with the points.

    Args:
        points: (n, 3).
        cutoff: Largest distance.
        apart: Least j − i.

    Returns:
        (P, 2) indices, ordered by i.
    """
    n = points.shape[0]
    found = np.empty((max(16, 8 * n), 2), dtype=np.int64)
    count = 0
    limit = cutoff * cutoff
    if n < SKIP_BELOW:
        for i in range(n):
            j = i + apart
            while j < n:
                dx = points[i, 0] - points[j, 0]
                dy = points[i, 1] - points[j, 1]
                dz = points[i, 2] - points[j, 2]
                square = dx * dx + dy * dy + dz * dz
                if square < limit:
                    found = append_pair(found, count, i, j)
                    count += 1
                    j += 1
                else:
                    # Neighbours along the chain are at most one pitch apart, so whoever is farther
                    # away than the cutoff by k pitches has k followers that are too far as well.
                    # A distance that is no number says nothing, and as an integer it is anything.
                    j += 1
                    if square < FARTHEST_SQUARE:
                        j += int(np.sqrt(square) - cutoff)
        return found[:count].copy()
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
                                found = append_pair(found, count, i, int(j))
                                count += 1
                        j = following[j]
    return found[:count].copy()


@njit(**KERNEL)
def repulsion(points: Array, pairs: Pairs, gain: float, out: Array) -> None:
    """Adds eq. 3 of the paper to ``out`` (n, 3): gain / distance², away from each other."""
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        dx = points[i, 0] - points[j, 0]
        dy = points[i, 1] - points[j, 1]
        dz = points[i, 2] - points[j, 2]
        square = max(dx * dx + dy * dy + dz * dz, 1e-6)
        scale = gain / (square * np.sqrt(square))
        out[i, 0] += scale * dx
        out[i, 1] += scale * dy
        out[i, 2] += scale * dz
        out[j, 0] -= scale * dx
        out[j, 1] -= scale * dy
        out[j, 2] -= scale * dz


@njit(**INNER)
def haste(
    gap: Array, velocity: Array, turning: float, cap: float, slide: float, reach: float
) -> float:
    """How many times a pair's motion in a unit of time is more than it may be in a step.

    Args:
        gap: (3,) from one centre to the other.
        velocity: (3,) of the other, as seen from the one.
        turning: Speed of a surface point that their relative spin gives.
        cap: How much nearer they may come.
        slide: How far they may slide along each other.
        reach: Distance from which on they are apart for certain; half of what is more they may
            move besides.
    """
    distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
    closing = 0.0
    square = 0.0
    for r in range(3):
        closing -= velocity[r] * gap[r]
        square += velocity[r] * velocity[r]
    closing = max(closing / max(distance, 1e-9), 0.0) + turning
    room = max(distance - reach, 0.0)
    return max(closing / (cap + 0.5 * room), (np.sqrt(square) + turning) / (slide + 0.5 * room))


@njit(**INNER)
def haste_of_pair(
    i: int,
    j: int,
    points: Array,
    velocities: Array,
    spins: Array,
    radius: float,
    cap: float,
    slide: float,
    gap: Array,
    velocity: Array,
) -> float:
    """``haste`` of two modules of the same radius, as seen from half way between them.

    ``gap`` (3,) and ``velocity`` (3,) are written.
    """
    for r in range(3):
        gap[r] = points[j, r] - points[i, r]
    wx = 0.5 * (spins[i, 0] + spins[j, 0])
    wy = 0.5 * (spins[i, 1] + spins[j, 1])
    wz = 0.5 * (spins[i, 2] + spins[j, 2])
    velocity[0] = velocities[j, 0] - velocities[i, 0] - (wy * gap[2] - wz * gap[1])
    velocity[1] = velocities[j, 1] - velocities[i, 1] - (wz * gap[0] - wx * gap[2])
    velocity[2] = velocities[j, 2] - velocities[i, 2] - (wx * gap[1] - wy * gap[0])
    turning = 0.0
    for r in range(3):
        turning += (spins[j, r] - spins[i, r]) ** 2
    return haste(gap, velocity, radius * np.sqrt(turning), cap, slide, 2.0 * radius)


@njit(**KERNEL)
def largest_haste(
    points: Array,
    velocities: Array,
    spins: Array,
    pairs: Pairs,
    radius: float,
    cap: float,
    slide: float,
) -> float:
    """The largest ``haste`` of near pairs.

    Args:
        points, velocities, spins: (n, 3) of the modules, in the world.
        pairs: (P, 2) near ones.
        radius: The module's.
        cap, slide: How much nearer a pair may come in a step, and how far it may slide.
    """
    worst = 0.0
    gap = np.empty(3)
    velocity = np.empty(3)
    for k in range(pairs.shape[0]):
        worst = max(
            worst,
            haste_of_pair(
                pairs[k, 0],
                pairs[k, 1],
                points,
                velocities,
                spins,
                radius,
                cap,
                slide,
                gap,
                velocity,
            ),
        )
    return worst
