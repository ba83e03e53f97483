"""Budget: what an explosion may use, and what of it was used up."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.chain.chain import Chain
from planner.explosion.evidence import BudgetEvidence
from planner.explosion.explosion import MOST_PUSHES, MOST_RETRIES
from planner.explosion.paper import MOST_ANGLES
from planner.motion.frames import Frames
from planner.motion.record import Record
from planner.motion.stuck_figures import Spent
from planner.parameters.parameters import Parameters
from planner.parameters.published import PaperExplosionParameters

SLIGHT_RAD: Final = 0.1
"""Bends below this are not told at all."""


def budget(chain: Chain, record: Record, last: Frames, parameters: Parameters) -> BudgetEvidence:
    """What an explosion that does not end straight has used up.

    Args:
        chain: The chain.
        record: What was recorded; its status tells what came to its end.
        last: Its last frame.
        parameters: What it was made with.
    """
    angles = np.abs(last.joint_angles_rad[0])
    spent, allowed, used = _spent(chain, record, parameters)
    return BudgetEvidence(
        spent=spent,
        allowed=allowed,
        used=used,
        bent_hinges=int((angles > SLIGHT_RAD).sum()),
        largest_bend_rad=float(angles.max(initial=0.0)),
    )


def _spent(chain: Chain, record: Record, parameters: Parameters) -> tuple[Spent, int, int]:
    """Of what there was a limit, which one, and how much was used."""
    how = parameters.explosion
    if record.strategy == "peel":
        steps = parameters.peeling.most_steps(len(chain))
    else:
        steps = record.steps if how is None else how.max_steps
    published = isinstance(how, PaperExplosionParameters)
    if record.status == "diverged":
        if record.strategy == "peel":
            return "pushes", MOST_PUSHES[record.strategy], record.pushes
        return "retries", 0 if published else MOST_RETRIES, record.retries
    if record.status == "stalled":
        if published:
            return "motion", steps, record.steps
        return "pushes", MOST_PUSHES[record.strategy], record.pushes
    if published and record.steps < steps and record.snapshots_rad is not None:
        return "snapshots", MOST_ANGLES // len(chain.folded_rad), len(record.snapshots_rad)
    return "steps", steps, record.steps
