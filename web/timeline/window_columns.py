"""Window columns: snapshots of a windowed motion as columns of a compact message.

``first`` and ``counts`` give each window's first hinge and its number of hinges, ``steps`` the
concatenated angles of all windows. An angle is an integer number of ``SENT_ANGLE_STEP_RAD``,
stored as its difference from the same hinge's angle in the previous snapshot: from the folded angle
if that window began later, from 0 if it had ended. Angles of the first snapshot are absolute.

If joint errors are recorded, ``errors_rad`` holds those of all windows and ``recorded`` marks the
snapshots that have them; hinges outside the window then have no error. Otherwise these columns are
absent.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.motion.angle_encoding import window_differences
from foldback.planner.motion.motion import Motion

Ints = NDArray[np.int64]
SENT_ANGLE_STEP_RAD: Final = 2.0**-20
"""Quantisation step of the joint angles that browsers receive, in rad."""
PLANE_COLUMNS: Final = frozenset(
    {
        *("time_s", "phase", "root_position", "root_wxyz"),
        *("first", "counts", "steps", "base_position", "base_wxyz", "recorded"),
    }
)
"""Names of the arrays of a motion, dense or in windows, whose bytes are grouped by significance
before compression, without loss: constant or evenly changing values then take almost no space."""
SHORT_COLUMNS: Final = frozenset({"errors_rad", "joint_error_rad"})
"""Names of the arrays of a motion, in windows or dense, that are sent with the upper half of each
single-precision number only, a relative precision of 1 in 256."""


def window_columns(windows: Motion, folded_rad: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """Return the columns of snapshots of a chain with the folded angles ``folded_rad``."""
    counts = np.diff(windows.offsets)
    changes = window_differences(
        windows.first, windows.offsets, whole_steps(windows.angles_rad), whole_steps(folded_rad)
    )
    recorded = windows.recorded
    errors = {"errors_rad": windows.errors.astype("<f4"), "recorded": recorded.astype("|u1")}
    return {
        "time_s": windows.time_s.astype("<f8"),
        "phase": windows.phase.astype("|u1"),
        "first": windows.first.astype("<i4"),
        "counts": counts.astype("<i4"),
        "steps": changes.astype("<i4"),
        "base_position": windows.anchor_position.astype("<f8"),
        "base_wxyz": windows.anchor_wxyz.astype("<f8"),
        **(errors if recorded.any() else {}),
    }


def whole_steps(angles_rad: NDArray[np.floating[Any]]) -> Ints:
    """Return single-precision angles as integer steps; halves round up, as in browsers."""
    exact = angles_rad.astype(np.float32).astype(np.float64) / SENT_ANGLE_STEP_RAD
    return np.floor(exact + 0.5).astype(np.int64)
