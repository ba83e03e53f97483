"""Floating torques: the hinge torques that make a free chain move as it moved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.module import Module
from foldback.planner.core import many_floating_torques, many_path_torques
from foldback.planner.core.structures import ChainModel, Lumps
from foldback.planner.cpu_cores import cores


@dataclass(frozen=True, slots=True, kw_only=True)
class Floating:
    """Stretch of a chain in which all links have hinges, between two rigid bodies.

    Attributes:
        first: Number of its first module.
        lumps: The rigid bodies at its ends.
    """

    first: int
    lumps: Lumps


def floating_torques(
    module: Module,
    angles_rad: Array,
    rates: Array,
    accelerations: Array,
    stretch: Floating | None = None,
) -> Array:
    """Compute hinge torques of a chain that floats freely, without gravity, momentum or contacts.

    Args:
        module: The kind of module.
        angles_rad: (F, J) hinge angles.
        rates: (F, J) hinge velocities in rad/s.
        accelerations: (F, J) hinge accelerations in rad/s².
        stretch: Stretch of a chain that the hinges are those of; None for a whole chain.

    Returns:
        (F, J) torques in units of module mass · pitch² / s². They are linear in the accelerations
        and quadratic in the rates, so a motion k times slower takes 1/k² of them.
    """
    torques = np.empty(angles_rad.shape)
    motion = (angles_rad, rates, accelerations)
    _compute(many_floating_torques, module, stretch, motion, (torques,))
    return torques


def path_torques(
    module: Module, angles_rad: Array, first: Array, second: Array, stretch: Floating | None = None
) -> tuple[Array, Array]:
    """Compute terms of the hinge torques a ü + b u̇² of such a chain along a path q(u).

    Args:
        module: The kind of module.
        angles_rad: (F, J) hinge angles q.
        first, second: (F, J) derivatives q' and q'' by u.
        stretch: As in ``floating_torques``.

    Returns:
        (F, J) a and (F, J) b.
    """
    a, b = np.empty(angles_rad.shape), np.empty(angles_rad.shape)
    _compute(many_path_torques, module, stretch, (angles_rad, first, second), (a, b))
    return a, b


def _compute(
    kernel: Callable[..., None],
    module: Module,
    stretch: Floating | None,
    motion: Sequence[Array],
    out: Sequence[Array],
) -> None:
    """Call a kernel with (F, J) arrays that it reads and writes, some frames for each core."""
    hinges = motion[0].shape[1]
    if stretch is None:
        joint, first, lumps = module.joint, 0, Lumps.none()
        count = module.module_count(hinges)
    else:
        first, lumps = stretch.first, stretch.lumps
        joint, count = module.joint.window(first), hinges // module.hinges_per_joint + 1
    masses = module.masses(count, first)
    model = ChainModel(joint, masses, module.moments, lumps, False, 0)
    read = [np.ascontiguousarray(array) for array in motion]

    def of(part: slice) -> None:
        kernel(
            *(array[part] for array in read),
            model,
            *(array[part] for array in out),
        )

    parts = min(cores(), max(1, out[0].size // 100_000))
    if parts == 1:
        of(slice(None))
        return
    bounds = np.linspace(0, len(out[0]), parts + 1).astype(int).tolist()
    with ThreadPoolExecutor(parts) as threads:
        list(threads.map(of, map(slice, bounds[:-1], bounds[1:])))


def spline_derivatives(
    time_s: Array, angles_rad: Array, at: Ints, *, from_rest: bool
) -> tuple[Array, Array]:
    """Return rates and accelerations along recorded angles, by the cubic spline through them.

    Args:
        time_s: (F,) times, not falling.
        angles_rad: (F, J) hinge angles.
        at: (K,) numbers of the wanted frames.
        from_rest: True if nothing moves at the first time.

    Returns:
        (K, J) rates, rad/s, and (K, J) accelerations, rad/s²; NaN if there are too few times.
    """
    later = np.concatenate([[True], np.diff(time_s) > 0.0])
    if later.sum() < 4:  # a cubic spline without given rates at its ends needs four
        nothing = np.full((len(at), angles_rad.shape[1]), np.nan)
        return nothing, nothing
    from scipy.interpolate import CubicSpline  # late: who reads a plan asks for no accelerations

    start = (1, np.zeros(angles_rad.shape[1])) if from_rest else "not-a-knot"
    ends: Any = (start, "not-a-knot")
    curve = CubicSpline(time_s[later], angles_rad[later], bc_type=ends)
    return curve(time_s[at], 1), curve(time_s[at], 2)
