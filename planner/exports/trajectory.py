"""Trajectories as text: CSV for spreadsheets and controllers, JSON as ``foldback-trajectory/1``.

Both come in parts, so that a long one never is in memory as a whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import Sweep, sweep
from foldback.planner.errors import InputError
from foldback.planner.progress import Cancelled, never
from foldback.planner.trajectories.trajectory import Trajectory

Form = Literal["csv", "json"]
TRAJECTORY_FORMAT: Final = "foldback-trajectory/1"
ROWS_PER_PART: Final = 256
"""Number of rows of an exported trajectory that are formatted at once."""
MAX_RATE_HZ: Final = 1e5
"""Maximum sampling rate of an exported trajectory, in Hz; higher ones are refused as
implausible."""
MAX_ROWS: Final = 5_000_000
"""Maximum number of rows of an exported trajectory with a given sampling rate; more are refused. 80
minutes at 1 kHz."""
MAX_TOUCH_DEPTH_PITCH: Final = 1e-6
"""Maximum overlap of modules, in pitches, in an exported trajectory that counts as touching rather
than as a collision: rounding."""
MAX_RATE_DOUBLINGS: Final = 10
"""Maximum number of times that a sampling rate is doubled in search of one at which an exported
trajectory, interpolated linearly, is proved free of collisions; then no rate is recommended."""


def times(trajectory: Trajectory, rate_hz: float | None) -> Array:
    """Return (T,) strictly rising times of an export, in s: of the plan's frames, or even ones.

    Even ones end with the duration, which is half a step to one and a half after the last but one.

    Raises:
        InputError: ``bad-rate``.
    """
    if rate_hz is None:
        return np.unique(_short(trajectory.time_s))
    if not 0.0 < rate_hz <= MAX_RATE_HZ:
        raise InputError(
            "bad-rate",
            f"got a rate of {rate_hz:g} Hz, expected more than 0 and at most {MAX_RATE_HZ:g} Hz.",
            where="rate",
        )
    rows = trajectory.duration_s * rate_hz
    if rows > MAX_ROWS:
        raise InputError(
            "bad-rate",
            f"got a rate of {rate_hz:g} Hz over {trajectory.duration_s:g} s, which gives "
            f"{rows:.0f} rows, expected at most {MAX_ROWS} rows; lower the rate.",
            where="rate",
        )
    count = max(1, int(np.ceil(rows - 0.5)))
    return np.append(np.arange(count) / rate_hz, trajectory.duration_s)


def deviation(trajectory: Trajectory, rate_hz: float | None) -> float:
    """Return the farthest that any hinge is from the plan, in rad, with rows joined by lines.

    Lines between rows at the plan's frames are as far from it as the trajectory. Others cut off an
    arc besides, of acceleration a and duration t: at most a t² / 8, and half the way.
    """
    if rate_hz is None:
        return trajectory.deviation_rad
    longest_s = float(np.diff(times(trajectory, rate_hz)).max())
    return trajectory.deviation_rad + largest_chord_error(trajectory, longest_s)


def largest_chord_error(trajectory: Trajectory, step_s: float) -> float:
    """Return how far a line across so many seconds may be from the trajectory, in rad."""
    return min(
        trajectory.max_acceleration_rad_s2 * step_s**2 / 8.0,
        trajectory.max_speed_rad_s * step_s / 2.0,
    )


def clearance(
    trajectory: Trajectory,
    chain: Chain,
    *,
    module_size: float,
    rate_hz: float | None = None,
    cancelled: Cancelled = never,
) -> Sweep:
    """Return the clearance of the rows of an export, joined by straight lines in joint space.

    A controller that interpolates between rows moves like this. A cancelled sweep proves nothing:
    its bound is 0 at most.

    Args:
        trajectory: Trajectory of this chain.
        chain: The chain.
        module_size: Module size as a fraction of the pitch.
        rate_hz: Same as for ``export``.
        cancelled: Polled now and then; a long chain's sweep takes a while.

    Raises:
        InputError: ``bad-rate``.
    """
    rows = _short(trajectory.at(times(trajectory, rate_hz))[0])
    result = sweep(chain, rows, module_size=module_size, cancelled=cancelled)
    return replace(result, bound=min(result.bound, 0.0)) if cancelled() else result


def sufficient_rate(
    trajectory: Trajectory,
    chain: Chain,
    *,
    module_size: float,
    rate_hz: float,
    cancelled: Cancelled = never,
) -> float | None:
    """Return a rate above ``rate_hz``, by doubling it, at which rows are proved clear.

    None where there is none within ``MAX_RATE_DOUBLINGS``, or the search was cancelled.
    """
    for _ in range(MAX_RATE_DOUBLINGS):
        rate_hz *= 2.0
        if cancelled() or rate_hz > MAX_RATE_HZ:
            return None
        trajectory_clearance = clearance(
            trajectory, chain, module_size=module_size, rate_hz=rate_hz, cancelled=cancelled
        )
        if trajectory_clearance.bound > 0.0:
            return rate_hz
    return None


def export(
    trajectory: Trajectory,
    form: Form,
    *,
    name: str,
    plan_verified: bool,
    clear: tuple[float, float] | None = None,
    rate_hz: float | None = None,
) -> Iterator[bytes]:
    """Return a trajectory in parts.

    Args:
        trajectory: Trajectory to write.
        form: ``csv``: a line of names, then time, angles and speeds of each moment; ``json``.
        name: Name of the chain.
        plan_verified: True if the plan is verified, whose corners the trajectory cuts.
        clear: ``clearance`` and ``bound`` of its rows in pitches; None if they were not computed.
        rate_hz: Moments in a second; None for those of the plan's frames.

    Raises:
        InputError: ``bad-rate``.
    """
    moments = times(trajectory, rate_hz)
    if form == "csv":
        return _csv(trajectory, moments)
    min_clearance, proved = clear or (None, None)
    head = {
        "name": name,
        "plan_verified": plan_verified,
        "min_clearance": min_clearance,
        "clearance_bound": proved if proved and proved > 0.0 else None,
        "deviation_rad": deviation(trajectory, rate_hz),
    }
    return _json(trajectory, moments, head)


def _csv(trajectory: Trajectory, moments: Array) -> Iterator[bytes]:
    names = trajectory.joint_names
    heading = ["time_s", *(f"{n}_rad" for n in names), *(f"{n}_rad_s" for n in names)]
    yield (",".join(heading) + "\n").encode()
    for start in range(0, len(moments), ROWS_PER_PART):
        part = moments[start : start + ROWS_PER_PART]
        angles, speeds, _ = trajectory.at(part)
        rows = _short(np.column_stack([part, angles, speeds])).tolist()
        yield ("\n".join(",".join(map(repr, row)) for row in rows) + "\n").encode()


def _json(trajectory: Trajectory, moments: Array, attributes: dict[str, Any]) -> Iterator[bytes]:
    head = {
        "format": TRAJECTORY_FORMAT,
        **attributes,
        "max_speed_rad_s": trajectory.max_speed_rad_s,
        "max_acceleration_rad_s2": trajectory.max_acceleration_rad_s2,
        "duration_s": trajectory.duration_s,
        "joint_names": trajectory.joint_names,
        "time_s": _short(moments).tolist(),
    }
    yield _text(head)[:-1]
    for place, key in enumerate(("joint_angles_rad", "joint_speeds_rad_s")):
        yield f',"{key}":['.encode()
        for start in range(0, len(moments), ROWS_PER_PART):
            rows = trajectory.at(moments[start : start + ROWS_PER_PART])[place]
            yield (b"," if start else b"") + _text(_short(rows).tolist())[1:-1]
        yield b"]"
    yield b"}"


def _text(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


def _short(values: Array) -> Array:
    return np.round(values, 9) + 0.0
