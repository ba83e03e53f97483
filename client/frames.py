"""Frames of a fold's timeline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

FRAME_ARRAYS: Final = (
    "time_s",
    "phase",
    "joint_angles_rad",
    "root_position",
    "root_wxyz",
    "max_error_rad",
    "positions",
    "wxyzs",
)
"""Names of the arrays with one entry per frame in the JSON of the service."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """F frames of a chain with J hinges and n modules; lengths in pitches.

    Values are NumPy arrays if NumPy is installed, else lists; unknown ones are NaN or None.

    Attributes:
        status: Status of the timeline: ``growing``, ``complete`` or ``failed``.
        total: Number of frames of the timeline.
        start: Number of the first of these frames.
        stop: Number after the last of these frames.
        stride: Step between frame numbers.
        phases: Names of the phases; ``phase`` contains indices of these.
        joint_names: Names of the J hinges.
        time_s: (F,) times.
        phase: (F,) indices of the phases.
        joint_angles_rad: (F, J) joint angles.
        root_position: (F, 3) positions of the first module.
        root_wxyz: (F, 4) unit quaternions of the first module.
        max_error_rad: (F,) largest joint errors.
        positions: (F, n, 3) positions of the modules; None if not requested.
        wxyzs: (F, n, 4) unit quaternions of the modules; None if not requested.
    """

    status: str
    total: int
    start: int
    stop: int
    stride: int
    phases: tuple[str, ...]
    joint_names: tuple[str, ...]
    time_s: Any
    phase: Any
    joint_angles_rad: Any
    root_position: Any
    root_wxyz: Any
    max_error_rad: Any
    positions: Any
    wxyzs: Any

    @classmethod
    def of(cls, payload: Mapping[str, Any]) -> Frames:
        """Return the frames in a response."""
        return cls(
            status=payload["status"],
            total=payload["total"],
            start=payload["from"],
            stop=payload["to"],
            stride=payload["stride"],
            phases=tuple(payload["phases"]),
            joint_names=tuple(payload["joint_names"]),
            **{name: _array(name, payload[name]) for name in FRAME_ARRAYS},
        )

    def __len__(self) -> int:
        return len(self.time_s)


def _array(name: str, values: Any) -> Any:
    if values is None:
        return None
    try:
        import numpy as np
    except ImportError:
        return values
    return np.asarray(values, dtype=np.int64 if name == "phase" else np.float64)
