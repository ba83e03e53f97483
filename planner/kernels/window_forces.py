"""Forces on the active window of a chain that is peeled, and its step limit, compiled.

Window, core and tail are those of ``planner.kernels.folded_core``.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.folded_core import (
    FIXED,
    CoreCells,
    is_checked_core_cell,
    near_cells,
    tail_span,
)
from foldback.planner.kernels.kinematics import cross, vector
from foldback.planner.kernels.module import ModuleStates
from foldback.planner.kernels.pairs import (
    MIN_REPULSION_SQUARE,
    PairLimits,
    inverse_step_limit,
    pair_inverse_step_limit,
)

Array = NDArray[np.float64]


class StepLimits(NamedTuple):
    """Allowed displacements in one step, see ``planner.parameters.parameters``.

    Attributes:
        joint_rad: Turn of a hinge.
        body: Displacement of a module, in pitches.
        tail_turn_rad: Turn of the tail.
        pair: Displacements of two modules relative to each other.
    """

    joint_rad: float
    body: float
    tail_turn_rad: float
    pair: PairLimits


class WindowLoads(NamedTuple):
    """Strengths and directions of the forces on a window's m modules.

    Attributes:
        weights: (m,) relative radial gains of the modules.
        source: (3,) point from which the radial forces diverge.
        heading: (3,) unit vector of the pull on the last module.
        cutoff: Distance in pitches beyond which modules and cells do not repel.
        gain: γ of the paper's eq. 3.
        tension: Largest sum of radial forces beyond a joint.
        pull: Force along the heading.
    """

    weights: Array
    source: Array
    heading: Array
    cutoff: float
    gain: float
    tension: float
    pull: float


@njit(**KERNEL)
def window_forces(positions: Array, loads: WindowLoads, core: CoreCells) -> Array:
    """Return (m, 3) forces: radial ones (eq. 1 of the paper), the pull, and repulsion (eq. 3).

    Args:
        positions: (m, 3) centres of the window's modules, in the core's frame.
        loads: Strengths and directions.
        core: Cells that are still folded.
    """
    count = positions.shape[0]
    out = np.empty((count, 3))
    _write_radial_forces(positions, loads, out)
    for r in range(3):
        out[count - 1, r] += loads.pull * loads.heading[r]
    _add_repulsion(positions, loads, out)
    _add_core_repulsion(positions, loads, core, out)
    return out


@njit(**INNER)
def _write_radial_forces(positions: Array, loads: WindowLoads, out: Array) -> None:
    """Write (m, 3) radial forces, scaled to the tension."""
    count = positions.shape[0]
    for k in range(count):
        for r in range(3):
            out[k, r] = loads.weights[k] * (positions[k, r] - loads.source[r])
    largest = 0.0
    x = y = z = 0.0
    for k in range(count - 1, FIXED - 2, -1):
        x += out[k, 0]
        y += out[k, 1]
        z += out[k, 2]
        largest = max(largest, x * x + y * y + z * z)
    scale = loads.tension / np.sqrt(largest)
    for k in range(count):
        for r in range(3):
            out[k, r] *= scale


@njit(**INNER)
def _add_repulsion(positions: Array, loads: WindowLoads, out: Array) -> None:
    """Add to (m, 3) forces how the window's modules repel each other."""
    count = positions.shape[0]
    limit = loads.cutoff * loads.cutoff
    for i in range(FIXED, count):
        j = i + 2
        while j < count:
            x = positions[i, 0] - positions[j, 0]
            y = positions[i, 1] - positions[j, 1]
            z = positions[i, 2] - positions[j, 2]
            square = x * x + y * y + z * z
            if square < limit:
                square = max(square, MIN_REPULSION_SQUARE)
                scale = loads.gain / (square * np.sqrt(square))
                out[i, 0] += scale * x
                out[i, 1] += scale * y
                out[i, 2] += scale * z
                out[j, 0] -= scale * x
                out[j, 1] -= scale * y
                out[j, 2] -= scale * z
                j += 1
            else:
                j += _links_to_skip(square, loads.cutoff)


@njit(**INNER)
def _links_to_skip(square: float, cutoff: float) -> int:
    """Return the links to the next module that may be near: consecutive ones are at most 1 apart.

    Args:
        square: Squared distance of this one, which is beyond the cutoff.
        cutoff: Distance up to which modules are near.
    """
    return max(1, int(np.floor(np.sqrt(square) - cutoff)))


@njit(**INNER)
def _add_core_repulsion(positions: Array, loads: WindowLoads, core: CoreCells, out: Array) -> None:
    """Add to (m, 3) forces how the core's cells repel the window: gain / distance² each."""
    grid, low, box, first = core
    reach = int(np.ceil(loads.cutoff))
    limit = loads.cutoff * loads.cutoff
    for k in range(FIXED, positions.shape[0]):
        x_low, x_end, y_low, y_end, z_low, z_end = near_cells(box, positions[k], reach)
        for x in range(x_low, x_end):
            dx = positions[k, 0] - x
            for y in range(y_low, y_end):
                dy = positions[k, 1] - y
                for z in range(z_low, z_end):
                    module = int(grid[x - low[0], y - low[1], z - low[2]])
                    if not is_checked_core_cell(module, first, k):
                        continue
                    dz = positions[k, 2] - z
                    square = dx * dx + dy * dy + dz * dz
                    if square >= limit:
                        continue
                    distance = np.sqrt(max(square, MIN_REPULSION_SQUARE))
                    scale = loads.gain / (distance * distance * distance)
                    out[k, 0] += scale * dx
                    out[k, 1] += scale * dy
                    out[k, 2] += scale * dz


@njit(**KERNEL)
def window_inverse_step_limit(
    qd: Array,
    modules: ModuleStates,
    core: CoreCells,
    tail: int,
    cutoff: float,
    limits: StepLimits,
) -> float:
    """Return 1/Δt_max in 1/s of window and tail: the largest ratio of speed to displacement limit.

    Args:
        qd: (J,) rates of the window's hinges.
        modules: Poses and velocities of the window's modules.
        core: Cells that are still folded.
        tail: Number of modules of the tail.
        cutoff: Distance in pitches beyond which pairs are not checked.
        limits: Displacements that are allowed in one step.
    """
    largest = max(
        _core_inverse_step_limit(modules, core, cutoff, limits.pair),
        _pairs_inverse_step_limit(modules, cutoff, limits.pair),
    )
    fastest = 0.0
    for k in range(qd.shape[0]):
        fastest = max(fastest, abs(qd[k]))
    largest = max(largest, fastest / limits.joint_rad)
    fastest = 0.0
    velocities = modules.velocities
    for k in range(velocities.shape[0]):
        square = 0.0
        for r in range(3):
            square += velocities[k, r] * velocities[k, r]
        fastest = max(fastest, square)
    largest = max(largest, np.sqrt(fastest) / limits.body)
    if tail == 0:
        return largest
    largest = max(largest, _tail_speed(modules, core, tail, cutoff, limits) / limits.pair.approach)
    # However long it is, a tail outside the box must not come in within one step.
    omega = modules.angular_velocities[-1]
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    return max(largest, rate / limits.tail_turn_rad)


@njit(**INNER)
def _core_inverse_step_limit(
    modules: ModuleStates, core: CoreCells, cutoff: float, limits: PairLimits
) -> float:
    """Return the largest inverse step limit in 1/s of the window's modules against the core."""
    grid, low, box, first = core
    positions, omega = modules.positions, modules.angular_velocities
    largest = 0.0
    reach = int(np.ceil(cutoff))
    limit = cutoff * cutoff
    for k in range(FIXED, positions.shape[0]):
        rate = np.sqrt(omega[k, 0] ** 2 + omega[k, 1] ** 2 + omega[k, 2] ** 2)
        velocity = vector(modules.velocities[k])
        x_low, x_end, y_low, y_end, z_low, z_end = near_cells(box, positions[k], reach)
        for x in range(x_low, x_end):
            dx = positions[k, 0] - x
            for y in range(y_low, y_end):
                dy = positions[k, 1] - y
                for z in range(z_low, z_end):
                    module = int(grid[x - low[0], y - low[1], z - low[2]])
                    if not is_checked_core_cell(module, first, k):
                        continue
                    dz = positions[k, 2] - z
                    if dx * dx + dy * dy + dz * dz < limit:
                        limited = inverse_step_limit(
                            (dx, dy, dz), velocity, limits.radius * rate, limits
                        )
                        largest = max(largest, limited)
    return largest


@njit(**INNER)
def _pairs_inverse_step_limit(modules: ModuleStates, cutoff: float, limits: PairLimits) -> float:
    """Return the largest inverse step limit in 1/s of the window's modules against each other."""
    positions = modules.positions
    largest = 0.0
    count = positions.shape[0]
    for i in range(FIXED, count):
        j = i + 2
        while j < count:
            square = 0.0
            for r in range(3):
                square += (positions[j, r] - positions[i, r]) ** 2
            if square < cutoff * cutoff:
                largest = max(largest, pair_inverse_step_limit(i, j, modules, limits))
                j += 1
            else:
                j += _links_to_skip(square, cutoff)
    return largest


@njit(**INNER)
def _tail_speed(
    modules: ModuleStates, core: CoreCells, tail: int, cutoff: float, limits: StepLimits
) -> float:
    """Return the largest speed of a point of the tail near the core, 0 if none is there.

    Along a line, the square of the speed is convex: it is largest at one of the ends.
    """
    end = modules.positions.shape[0] - 1
    rotation = modules.rotations[end]
    direction = (rotation[0, 0], rotation[1, 0], rotation[2, 0])
    velocity, omega = modules.velocities[end], vector(modules.angular_velocities[end])
    low, high = core.box[0] - cutoff, core.box[1] + cutoff
    a, b = tail_span(modules.positions[end], direction, tail, low, high)
    if a >= b:
        return 0.0
    fastest = 0.0
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    turning = cross(omega, direction)
    for k in (a, b - 1):
        x = velocity[0] + k * turning[0]
        y = velocity[1] + k * turning[1]
        z = velocity[2] + k * turning[2]
        fastest = max(fastest, np.sqrt(x * x + y * y + z * z) + limits.pair.radius * rate)
    return fastest
