"""Exporting: the best attempt → plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from foldback.planner.chain.chain import Chain
from foldback.planner.pipeline.attempt import Attempt, Candidates
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.search import Result, is_smoothing
from foldback.planner.plan.plan import Plan


def finish(
    request: FoldRequest,
    result: Result,
    history: Sequence[Attempt],
    *,
    candidates: Candidates,
    start: Chain | None,
    recorded: Plan | None,
) -> Plan:
    """Return the plan of a fold that is over, with all that was tried.

    Args:
        request: Request of the fold.
        result: Result of the best attempt.
        history: All attempts.
        candidates: Chains that the fold could choose from.
        start: Chain as it is folded at the beginning of a refold; None for other folds.
        recorded: Plan that was smoothed; None for an explosion.
    """
    plan = replace(
        result.plan(request),
        attempts=tuple(attempt.as_dict() for attempt in history if attempt.status != "none"),
        start=start,
        likeness=candidates.likeness_of(result.chain),
    )
    if not is_smoothing(result.record):
        return plan
    from foldback.planner.smoothing.smoothed_plan import before_and_after  # late: rarely needed

    assert recorded is not None
    return replace(plan, smoothing=before_and_after(recorded, plan))
