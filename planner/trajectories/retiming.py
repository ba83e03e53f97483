"""Retiming: the time stamps at which a robot with given joints passes along a plan.

The path is the plan's own, straight from frame to frame, with its corners cut, for a corner needs
an infinite acceleration: on either side of a frame, up to the middle of the shorter of its two
steps, a parabola replaces the two straight lines. It is farthest from them at the frame;
``Trajectory.deviation_rad`` is that distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.core import fastest_profile
from foldback.planner.errors import InputError
from foldback.planner.plan.plan import Plan
from foldback.planner.trajectories.trajectory import CutPath, Trajectory

Indices = NDArray[np.int64]
MAX_STILL_TURN_RAD: Final = 1e-6
"""Maximum turn of the fastest hinge, in rad, between frames that are merged into one when a plan
gets a new timing, as nothing moves."""
RATE_LIMIT_RANGE: Final = (1e-6, 1e6)
"""Minimum and maximum limit of speed (rad/s) and of acceleration (rad/s²) that is accepted for a
new timing of a plan; others are refused as implausible."""


def retime(plan: Plan, max_speed_rad_s: float, max_acceleration_rad_s2: float) -> Trajectory:
    """Return the fastest trajectory along a plan within bounds of hinge speed and acceleration.

    Args:
        plan: A plan with frames.
        max_speed_rad_s: Bound of every hinge's |speed|.
        max_acceleration_rad_s2: Bound of every hinge's |acceleration|.

    Raises:
        InputError: ``bad-bound`` for a bound out of range, ``no-motion`` for a plan in which no
            hinge moves.
    """
    return retimed(
        plan.joint_angles_rad, plan.chain.joint_names, max_speed_rad_s, max_acceleration_rad_s2
    )


def retimed(
    frames: Array,
    joint_names: tuple[str, ...],
    max_speed_rad_s: float,
    max_acceleration_rad_s2: float,
) -> Trajectory:
    """Return the fastest trajectory along (F, J) angles, see ``retime``."""
    for name, unit, value in (
        ("speed", "rad/s", max_speed_rad_s),
        ("acceleration", "rad/s²", max_acceleration_rad_s2),
    ):
        if not RATE_LIMIT_RANGE[0] <= value <= RATE_LIMIT_RANGE[1]:
            raise InputError(
                "bad-bound",
                f"got a maximum {name} of {value:g} {unit}, expected {RATE_LIMIT_RANGE[0]:g} to "
                f"{RATE_LIMIT_RANGE[1]:g}.",
                where=f"max_{name}",
            )
    corner_frames = _moving(frames)
    if len(corner_frames) < 2:
        raise InputError(
            "no-motion",
            "got a plan in which no hinge turns, expected a plan in which at least one "
            "hinge turns.",
        )
    corners = np.ascontiguousarray(frames[corner_frames])
    corners[-1] = frames[-1]  # so that the end is exact
    path = CutPath.through(corners)
    lengths = np.diff(path.knots)
    # No hinge gets faster than this over the whole way. Far larger bounds would cost all digits.
    attainable_rad_s = float(np.sqrt(2.0 * max_acceleration_rad_s2 * lengths.sum()))
    middle = path.places[path.frame]
    ends = np.stack([path.knots[:-1] - middle, path.knots[1:] - middle], axis=1)
    x = fastest_profile(
        path.slopes,
        path.left,
        path.right,
        0.5 + 0.5 * ends / path.reach[:, None],
        lengths,
        min(float(max_speed_rad_s), attainable_rad_s),
        float(max_acceleration_rad_s2),
    )
    rates = np.sqrt(x)
    times = np.concatenate([[0.0], np.cumsum(2.0 * lengths / (rates[1:] + rates[:-1]))])
    # Frames that were left out are passed at the same moment as those before them.
    owner = np.searchsorted(corner_frames, np.arange(len(frames)), side="right") - 1
    last = np.append(corner_frames[1:], len(frames)) - 1
    passed = np.interp(path.places, path.knots, times)[owner]
    return Trajectory(
        joint_names=joint_names,
        time_s=passed,
        max_speed_rad_s=float(max_speed_rad_s),
        max_acceleration_rad_s2=float(max_acceleration_rad_s2),
        deviation_rad=path.deviation() + (len(corner_frames) < len(frames)) * MAX_STILL_TURN_RAD,
        path=path,
        knot_times_s=times,
        knot_rates=rates,
        frame_numbers=np.stack([corner_frames, last], axis=1).ravel().astype(np.float64),
    )


def _moving(frames: Array) -> Indices:
    """Return (K,) numbers of the first frame, and of those that differ from the one before."""
    moving_frames: list[int] = []
    for k in range(len(frames)):
        if (
            not moving_frames
            or np.abs(frames[k] - frames[moving_frames[-1]]).max() > MAX_STILL_TURN_RAD
        ):
            moving_frames.append(k)
    return np.array(moving_frames, dtype=np.int64)
