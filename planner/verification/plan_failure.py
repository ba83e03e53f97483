"""Plan failure: a check of the reason of a plan's failed explosion against its record.

Where ``foldback_check_refusals.py`` checks a reason too, both have to confirm it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

from foldback import foldback_check_refusals
from foldback.planner.explosion.diagnosis import Diagnosis, stuck_of
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import Differences, value_differences
from foldback.planner.storage.file_names import PLAN, RECORD
from foldback.planner.verification.failure_evidence import ReasonCheck, check_reason


def reason_of(directory: FilePath, plan: Plan, notes: list[str]) -> ReasonCheck | None:
    """Check the reason that a plan gives for an explosion that did not end straight.

    Args:
        directory: Directory of the fold, with ``plan.npz`` and ``record.npz``.
        plan: Its plan.
        notes: Receives a note if the check is not possible.
    """
    stuck, record = stuck_of(plan.explosion, plan.attempts), Workspace(directory).read_record()
    check = stuck and record and check_reason(plan.chain, record, stuck, plan.parameters)
    if stuck is None or check is None:
        notes.append(
            "The reason for the failure was not checked. The check needs record.npz, and evidence "
            "in the attempts of plan.npz."
        )
        return None
    words = Diagnosis.from_dict(stuck).text()
    word_differences = value_differences(stuck["words"], words, "words")
    alone = _unconfirmed(directory) if check.kind in foldback_check_refusals.REASONS else ()
    return replace(check, differences=(*check.differences, *word_differences, *alone))


def _unconfirmed(directory: FilePath) -> Differences:
    """Yield what the independent checker cannot confirm from plan and record alone."""
    try:
        result = foldback_check_refusals.check(directory / PLAN, directory / RECORD)
    except ValueError as error:
        result = {"verdict": "no plan", "reason": str(error)}
    if result["verdict"] != "refusal confirmed":
        yield f"the independent checker does not confirm the reason: {result['reason']}"
