"""Budget: the limit that ended an explosion, and how bent the chain still was."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.explosion.evidence import BudgetEvidence
from planner.motion.motion import Motion
from planner.motion.record import Record

SLIGHT_BEND_RAD: Final = 0.1
"""Maximum bend, rad, of a hinge that is not reported as bent. Larger values report fewer.
Chosen."""


def budget(record: Record, last: Motion) -> BudgetEvidence | None:
    """Return what an explosion has used up; None if its record does not say, as earlier ones.

    Args:
        record: Record of an explosion that does not end straight.
        last: Its last frame.
    """
    if record.spent is None:
        return None
    angles = np.abs(last.joint_angles_rad[0])
    return BudgetEvidence(
        spent=record.spent.kind,
        allowed=record.spent.allowed,
        used=record.spent.used,
        bent_hinges=int((angles > SLIGHT_BEND_RAD).sum()),
        largest_bend_rad=float(angles.max(initial=0.0)),
    )
