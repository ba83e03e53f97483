"""CSV: the fold as text, a row for each frame, for pandas, NumPy and spreadsheets.

Times rise strictly: of frames at one time, between which nothing moves, there is the last.
"""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.exports.export import require_frames, rising
from foldback.planner.motion.motion import PHASES
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import find_steps

ROOT_COLUMNS = ("root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz")


def write(plan: Plan) -> bytes:
    """Return the frames as CSV text with one header line; the columns' names end in their units.

    Columns: ``time_s``, ``phase``, the root module's centre in metres and its unit quaternion,
    every hinge angle as ``<joint>_rad``, ``max_error_rad`` (empty where there was no simulation).
    All digits are kept. A plan that rests between steps has a last column, ``step``: the number of
    the step that the frame belongs to or ends; 0 before the first step.

    Raises:
        InputError: ``no-frames``.
    """
    require_frames(plan)
    joints = [f"{name}_rad" for name in plan.chain.joint_names]
    rising_frames = rising(plan.time_s)
    steps = _step_column(plan, rising_frames)
    names = [
        "time_s",
        "phase",
        *ROOT_COLUMNS,
        *joints,
        "max_error_rad",
        *(["step"] if steps else []),
    ]
    lines = [",".join(names)]
    frames = plan.whole()[rising_frames]
    numbers = np.column_stack(
        [frames.root_position * plan.chain.pitch_m, frames.root_wxyz, frames.joint_angles_rad]
    )
    for time_s, phase, row, error, step in zip(
        frames.time_s.tolist(),
        frames.phase.tolist(),
        numbers.tolist(),
        plan.max_error_rad[rising_frames].tolist(),
        steps or [""] * len(rising_frames),
        strict=True,
    ):
        last = "" if np.isnan(error) else repr(error)
        lines.append(f"{time_s!r},{PHASES[phase]},{','.join(map(repr, row))},{last}{step}")
    return ("\n".join(lines) + "\n").encode()


def _step_column(plan: Plan, frames: Ints) -> list[str]:
    """Return the end of each row, with the number of its step; none without steps."""
    steps = find_steps(plan)
    if steps is None:
        return []
    return [f",{step}" for step in np.searchsorted(steps.frames, frames).tolist()]
