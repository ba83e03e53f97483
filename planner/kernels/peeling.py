"""Forces on the window of a peeling, and how fast it may move, compiled.

The window, the core and the rod are those of ``planner.kernels.core``.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.core import FIXED, rod_span
from planner.kernels.pairs import haste, haste_of_pair

Array = NDArray[np.float64]
Grid = NDArray[np.int32]
Ints = NDArray[np.int64]


class Caps(NamedTuple):
    """What may happen in one step, see ``planner.parameters.parameters``."""

    joint_rad: float
    pair: float
    slide: float
    body: float
    turn_rad: float


@njit(**KERNEL)
def window_forces(
    positions: Array,
    weights: Array,
    source: Array,
    aim: Array,
    first: int,
    grid: Grid,
    low: Ints,
    core_box: Ints,
    cutoff: float,
    gain: float,
    tension: float,
    pull: float,
) -> Array:
    """(m, 3) forces: eq. 1 from a source, a pull on the last module, and eq. 3.

    Args:
        positions: (m, 3) centres of the window's modules, in cells.
        weights: (m,) of the radial force.
        source: (3,) where that comes from.
        aim: (3,) unit vector of the pull.
        first: Number of the window's first module in the chain.
        grid: (X, Y, Z) number of the module in each cell when folded, −1 for none.
        low: (3,) the cell that the grid begins with.
        core_box: (2, 3) the least and the largest cell of what is still folded.
        cutoff: Modules and cells farther apart don't repel.
        gain: γ of eq. 3.
        tension: The largest radial force that adds up from the end to a hinge.
        pull: The pull's size.
    """
    count = positions.shape[0]
    out = np.empty((count, 3))
    for k in range(count):
        for r in range(3):
            out[k, r] = weights[k] * (positions[k, r] - source[r])
    largest = 0.0
    x = y = z = 0.0
    for k in range(count - 1, FIXED - 2, -1):
        x += out[k, 0]
        y += out[k, 1]
        z += out[k, 2]
        largest = max(largest, x * x + y * y + z * z)
    out *= tension / np.sqrt(largest)
    for r in range(3):
        out[count - 1, r] += pull * aim[r]
    limit = cutoff * cutoff
    gap = np.empty(3)
    for i in range(FIXED, count):
        j = i + 2
        while j < count:
            square = 0.0
            for r in range(3):
                gap[r] = positions[i, r] - positions[j, r]
                square += gap[r] * gap[r]
            if square < limit:
                square = max(square, 1e-6)
                scale = gain / (square * np.sqrt(square))
                for r in range(3):
                    out[i, r] += scale * gap[r]
                    out[j, r] -= scale * gap[r]
                j += 1
            else:
                # Consecutive centres are at most 1 apart.
                j += max(1, int(np.floor(np.sqrt(square) - cutoff)))
    _core_repulsion(positions, first, grid, low, core_box, cutoff, gain, out)
    return out


@njit(**INNER)
def _cells(place: float, reach: int, core_box: Ints, axis: int) -> tuple[int, int]:
    """Along an axis, the cells of the core within reach of a place: the first, and one past."""
    at = int(np.round(place))
    return max(at - reach, core_box[0, axis]), min(at + reach, core_box[1, axis]) + 1


@njit(**INNER)
def _core_repulsion(
    points: Array,
    first: int,
    grid: Grid,
    low: Ints,
    core_box: Ints,
    cutoff: float,
    gain: float,
    out: Array,
) -> None:
    """Adds to ``out`` (m, 3) how the core pushes the window away: gain / distance² a cell."""
    reach = int(np.ceil(cutoff))
    last = first + FIXED - 1
    limit = cutoff * cutoff
    for k in range(FIXED, points.shape[0]):
        x_low, x_end = _cells(points[k, 0], reach, core_box, 0)
        y_low, y_end = _cells(points[k, 1], reach, core_box, 1)
        z_low, z_end = _cells(points[k, 2], reach, core_box, 2)
        for x in range(x_low, x_end):
            dx = points[k, 0] - x
            for y in range(y_low, y_end):
                dy = points[k, 1] - y
                for z in range(z_low, z_end):
                    there = grid[x - low[0], y - low[1], z - low[2]]
                    if there < 0 or there > last or first + k - there < 2:
                        continue
                    dz = points[k, 2] - z
                    square = dx * dx + dy * dy + dz * dz
                    if square >= limit:
                        continue
                    distance = np.sqrt(max(square, 1e-6))
                    scale = gain / (distance * distance * distance)
                    out[k, 0] += scale * dx
                    out[k, 1] += scale * dy
                    out[k, 2] += scale * dz


@njit(**INNER)
def _rod_speed(
    end: Array,
    along: Array,
    rod: int,
    velocity: Array,
    spin: Array,
    radius: float,
    low: Array,
    high: Array,
) -> float:
    """The largest speed of a point of the rod inside a box, 0 when none is."""
    a, b = rod_span(end, along, rod, low, high)
    worst = 0.0
    size = np.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    for k in (a, b - 1):
        if a >= b:
            break
        x = velocity[0] + k * (spin[1] * along[2] - spin[2] * along[1])
        y = velocity[1] + k * (spin[2] * along[0] - spin[0] * along[2])
        z = velocity[2] + k * (spin[0] * along[1] - spin[1] * along[0])
        worst = max(worst, np.sqrt(x * x + y * y + z * z) + radius * size)
    return worst


@njit(**INNER)
def _haste_of_modules(
    points: Array,
    velocities: Array,
    spins: Array,
    first: int,
    grid: Grid,
    low: Ints,
    core_box: Ints,
    cutoff: float,
    radius: float,
    cap: float,
    slide: float,
) -> float:
    """How many times the window moves faster in a unit of time than it may in one step.

    Near modules may come nearer by ``cap`` and slide along each other by ``slide``; pairs that are
    apart for certain may move by half of the distance between them more.
    """
    worst = 0.0
    gap = np.empty(3)
    velocity = np.empty(3)
    count = points.shape[0]
    last = first + FIXED - 1
    reach = int(np.ceil(cutoff))
    limit = cutoff * cutoff
    touch = 2.0 * radius
    for k in range(FIXED, count):
        turning = radius * np.sqrt(spins[k, 0] ** 2 + spins[k, 1] ** 2 + spins[k, 2] ** 2)
        x_low, x_end = _cells(points[k, 0], reach, core_box, 0)
        y_low, y_end = _cells(points[k, 1], reach, core_box, 1)
        z_low, z_end = _cells(points[k, 2], reach, core_box, 2)
        for x in range(x_low, x_end):
            gap[0] = points[k, 0] - x
            for y in range(y_low, y_end):
                gap[1] = points[k, 1] - y
                for z in range(z_low, z_end):
                    there = grid[x - low[0], y - low[1], z - low[2]]
                    if there < 0 or there > last or first + k - there < 2:
                        continue
                    gap[2] = points[k, 2] - z
                    if gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2] < limit:
                        worst = max(worst, haste(gap, velocities[k], turning, cap, slide, touch))
    for i in range(FIXED, count):
        j = i + 2
        while j < count:
            square = 0.0
            for r in range(3):
                square += (points[j, r] - points[i, r]) ** 2
            if square < limit:
                worst = max(
                    worst,
                    haste_of_pair(
                        i, j, points, velocities, spins, radius, cap, slide, gap, velocity
                    ),
                )
                j += 1
            else:
                j += max(1, int(np.floor(np.sqrt(square) - cutoff)))
    return worst


@njit(**KERNEL)
def window_haste(
    rates: Array,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
    first: int,
    rod: int,
    grid: Grid,
    low: Ints,
    core_box: Ints,
    cutoff: float,
    radius: float,
    caps: Caps,
) -> float:
    """How many times window and rod move faster in a unit of time than they may in one step.

    Args:
        rates: (J,) of the window's hinges.
        positions, rotations, velocities, spins: Of its modules, in the world's frame.
        first: Number of the window's first module in the chain.
        rod: Modules of the rod.
        grid, low, core_box: See ``window_forces``.
        cutoff: Pairs farther apart are not looked at.
        radius: The module's.
        caps: What they may do.
    """
    worst = _haste_of_modules(
        positions,
        velocities,
        spins,
        first,
        grid,
        low,
        core_box,
        cutoff,
        radius,
        caps.pair,
        caps.slide,
    )
    fastest = 0.0
    for k in range(rates.shape[0]):
        fastest = max(fastest, abs(rates[k]))
    worst = max(worst, fastest / caps.joint_rad)
    fastest = 0.0
    for k in range(velocities.shape[0]):
        square = 0.0
        for r in range(3):
            square += velocities[k, r] * velocities[k, r]
        fastest = max(fastest, square)
    worst = max(worst, np.sqrt(fastest) / caps.body)
    if rod == 0:
        return worst
    end = positions.shape[0] - 1
    spin = spins[end]
    speed = _rod_speed(
        positions[end],
        rotations[end, :, 0].copy(),
        rod,
        velocities[end],
        spin,
        radius,
        core_box[0] - cutoff,
        core_box[1] + cutoff,
    )
    worst = max(worst, speed / caps.pair)
    # A rod that is outside may not come in within one step, so far out as it may reach.
    turning = np.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    return max(worst, turning / caps.turn_rad)
