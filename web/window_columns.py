"""Window columns: snapshots of ``planner.windows`` as columns of a message, with little to travel.

``first`` and ``counts`` tell where each window begins and how many hinges it has, ``steps`` the
angles of all windows one after the other. An angle is a whole number of ``ANGLE_STEP_RAD``, told as
its difference from what the same hinge had in the snapshot before: as it is folded where that one's
window began later, 0 where it had ended; the first snapshot's are told whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.windows import Windows

Ints = NDArray[np.int64]
ANGLE_STEP_RAD: Final = 2.0**-20
PLANES: Final = frozenset(
    {"time_s", "phase", "first", "counts", "steps", "base_position", "base_wxyz"}
)
"""All of them are packed: a base that rests and a time that runs evenly are next to nothing."""


def window_columns(windows: Windows, folded_rad: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """The columns of some snapshots of a chain that is folded at ``folded_rad``."""
    folded = whole_steps(folded_rad)
    steps = whole_steps(windows.angles_rad)
    counts = np.diff(windows.offsets)
    parts: list[Ints] = []
    before = np.zeros(0, np.int64)
    begin = end = 0
    for k, first in enumerate(windows.first.tolist()):
        now = steps[windows.offsets[k] : windows.offsets[k + 1]]
        last = first + len(now)
        expected = np.zeros(len(now), np.int64)
        if k:
            low, high = min(max(begin, first), last), min(max(end, first), last)
            expected[: low - first] = folded[first:low]
            expected[low - first : high - first] = before[low - begin : high - begin]
        parts.append(now - expected)
        before, begin, end = now, first, last
    return {
        "time_s": windows.time_s.astype("<f8"),
        "phase": windows.phase.astype("|u1"),
        "first": windows.first.astype("<i4"),
        "counts": counts.astype("<i4"),
        "steps": np.concatenate([np.zeros(0, np.int64), *parts]).astype("<i4"),
        "base_position": windows.base_position.astype("<f8"),
        "base_wxyz": windows.base_wxyz.astype("<f8"),
    }


def windows_of(columns: Mapping[str, Any], folded_rad: NDArray[np.floating[Any]]) -> Windows:
    """The snapshots that ``window_columns`` told, each angle to within half a step."""
    folded = whole_steps(folded_rad)
    offsets = np.concatenate([[0], np.cumsum(columns["counts"], dtype=np.int64)])
    steps = columns["steps"].astype(np.int64)
    whole = np.zeros(len(folded), np.int64)
    begin = end = 0
    for k, first in enumerate(columns["first"].tolist()):
        now = steps[offsets[k] : offsets[k + 1]]
        last = first + len(now)
        if k:
            whole[first:begin] = folded[first:begin]
            whole[max(first, end) : last] = 0
            now += whole[first:last]
        whole[first:last] = now
        begin, end = first, last
    return Windows(
        time_s=columns["time_s"],
        phase=columns["phase"],
        first=columns["first"].astype(np.int64),
        offsets=offsets,
        angles_rad=(steps * ANGLE_STEP_RAD).astype(np.float32),
        base_position=columns["base_position"],
        base_wxyz=columns["base_wxyz"],
    )


def whole_steps(angles_rad: NDArray[np.floating[Any]]) -> Ints:
    """Angles in single precision as whole steps; a half is rounded up, as browsers do."""
    exact = angles_rad.astype(np.float32).astype(np.float64) / ANGLE_STEP_RAD
    return np.floor(exact + 0.5).astype(np.int64)
