"""Trajectories as text: CSV for spreadsheets and controllers, JSON as ``foldback-trajectory/1``.

Both come in parts, so that a long one never is in memory as a whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.robot.trajectory import Trajectory

Array = NDArray[np.float64]
Form = Literal["csv", "json"]
FORMAT: Final = "foldback-trajectory/1"
DIGITS: Final = 9
LINES: Final = 256
LARGEST_RATE_HZ: Final = 1e5


def times(trajectory: Trajectory, rate_hz: float | None) -> Array:
    """(T,) rising times of an export: those of the plan's frames, or evenly spaced and the end.

    Raises:
        InputError: ``bad-rate``.
    """
    if rate_hz is None:
        return np.unique(trajectory.time_s)
    if not 0.0 < rate_hz <= LARGEST_RATE_HZ:
        raise InputError(
            "bad-rate",
            f"got a rate of {rate_hz:g} Hz, expected more than 0, at most {LARGEST_RATE_HZ:g}.",
            where="rate",
        )
    count = int(np.ceil(trajectory.duration_s * rate_hz - 1e-9))
    return np.append(np.arange(count) / rate_hz, trajectory.duration_s)


def export(
    trajectory: Trajectory,
    form: Form,
    *,
    name: str,
    plan_verified: bool,
    min_clearance: float | None = None,
    rate_hz: float | None = None,
) -> Iterator[bytes]:
    """A trajectory in parts.

    Args:
        trajectory: What to write.
        form: ``csv``: a line of names, then time, angles and speeds of each moment; ``json``.
        name: Of the chain.
        plan_verified: Whether the plan is, whose corners the trajectory cuts.
        min_clearance: Of the trajectory itself in pitches; None where nobody looked for it.
        rate_hz: Moments in a second; None for those of the plan's frames.

    Raises:
        InputError: ``bad-rate``.
    """
    moments = times(trajectory, rate_hz)
    if form == "csv":
        return _csv(trajectory, moments)
    head = {"name": name, "plan_verified": plan_verified, "min_clearance": min_clearance}
    return _json(trajectory, moments, head)


def _csv(trajectory: Trajectory, moments: Array) -> Iterator[bytes]:
    names = trajectory.joint_names
    heading = ["time_s", *(f"{n}_rad" for n in names), *(f"{n}_rad_s" for n in names)]
    yield (",".join(heading) + "\n").encode()
    for start in range(0, len(moments), LINES):
        part = moments[start : start + LINES]
        angles, speeds, _ = trajectory.at(part)
        rows = _short(np.column_stack([part, angles, speeds])).tolist()
        yield ("\n".join(",".join(map(repr, row)) for row in rows) + "\n").encode()


def _json(trajectory: Trajectory, moments: Array, what: dict[str, Any]) -> Iterator[bytes]:
    head = {
        "format": FORMAT,
        **what,
        "max_speed_rad_s": trajectory.max_speed_rad_s,
        "max_acceleration_rad_s2": trajectory.max_acceleration_rad_s2,
        "duration_s": trajectory.duration_s,
        "deviation_rad": trajectory.deviation_rad,
        "joint_names": trajectory.joint_names,
        "time_s": _short(moments).tolist(),
    }
    yield _text(head)[:-1]
    for place, key in enumerate(("joint_angles_rad", "joint_speeds_rad_s")):
        yield f',"{key}":['.encode()
        for start in range(0, len(moments), LINES):
            rows = trajectory.at(moments[start : start + LINES])[place]
            yield (b"," if start else b"") + _text(_short(rows).tolist())[1:-1]
        yield b"]"
    yield b"}"


def _text(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


def _short(values: Array) -> Array:
    return np.round(values, DIGITS) + 0.0
