"""Reasons in plans: the reason of a failed explosion, checked against its record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

from planner.explosion.diagnosis import Diagnosis, stuck_of
from planner.pipeline.workspace import Workspace
from planner.plan.differences import value_differences
from planner.plan.plan import Plan
from planner.verification.reasons import ReasonCheck, check_reason


def reason_of(directory: FilePath, plan: Plan, notes: list[str]) -> ReasonCheck | None:
    """Check the reason that a plan gives for an explosion that did not end straight.

    Args:
        directory: Directory of the fold, with ``record.npz``.
        plan: Its plan.
        notes: Receives a note if the check is not possible.
    """
    stuck, record = stuck_of(plan.explosion, plan.attempts), Workspace(directory).read_record()
    found = stuck and record and check_reason(plan.chain, record, stuck, plan.parameters)
    if stuck is None or found is None:
        notes.append(
            "The reason of the stall was not checked. The check needs record.npz and the evidence "
            "in plan.npz attempts, which earlier versions did not write."
        )
        return None
    words = Diagnosis.from_dict(stuck).words
    other = value_differences(stuck["words"], words, "words")
    return replace(found, differences=(*found.differences, *other))
