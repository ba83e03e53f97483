"""Decoding of messages for browsers: the inverse of ``web.timeline.columns``, as pages do it."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foldback.planner.motion.angle_encoding import whole_numbers, window_totals
from foldback.planner.motion.motion import Motion
from foldback.web.timeline.window_columns import SENT_ANGLE_STEP_RAD, whole_steps


def decode(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the header and the arrays of a message made by ``encode``."""
    length = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + length])
    return header, {c["name"]: _column(c, message, 4 + length) for c in header.pop("columns")}


def _column(column_values: dict[str, Any], message: bytes, start: int) -> NDArray[Any]:
    at, dtype = start + column_values["at"], np.dtype(column_values["dtype"])
    shape = column_values["shape"]
    if "size" not in column_values:
        return np.frombuffer(message, dtype, int(np.prod(shape)), at).reshape(shape)
    planes = np.frombuffer(zlib.decompress(message[at : at + column_values["size"]]), np.uint8)
    planes = planes.reshape(dtype.itemsize, -1)
    if "step" in column_values:
        steps = whole_numbers(planes).reshape(shape)
        for _ in range(column_values["differences"]):
            steps = steps.cumsum(axis=0)
        return (steps * column_values["step"]).astype("<f4")
    values = np.ascontiguousarray(planes.T).view(dtype).reshape(shape)
    if column_values.get("short"):
        return (values.astype("<u4") << 16).view("<f4")
    return values


def windows_of(columns: Mapping[str, Any], folded_rad: NDArray[np.floating[Any]]) -> Motion:
    """Return the snapshots in ``window_columns``.

    Angles are exact to half a step; errors are unchanged.
    """
    offsets = np.concatenate([[0], np.cumsum(columns["counts"], dtype=np.int64)])
    first = columns["first"].astype(np.int64)
    steps = window_totals(first, offsets, columns["steps"], whole_steps(folded_rad))
    return Motion.from_windows(
        time_s=columns["time_s"],
        phase=columns["phase"],
        first=first,
        offsets=offsets,
        angles_rad=(steps * SENT_ANGLE_STEP_RAD).astype(np.float32),
        base_position=columns["base_position"],
        base_wxyz=columns["base_wxyz"],
        errors_rad=columns.get("errors_rad"),
    )
