"""Plan count: the number of the plan that a fold computes, and about how many it computes in all.

The total is known where a preference has the fold go on after its first verified plan. It assumes
that each further plan is verified, so it may change while the fold runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from planner.pipeline import attempts
from planner.pipeline.attempt import Attempt
from planner.pipeline.portfolio import Portfolio
from planner.pipeline.preference import PlanFigures
from planner.progress import Report

ASSUMED: Final = PlanFigures(
    fold_time_s=None, peak_torque_nm=None, clearance_bound=None, frames=1, seconds=0.0
)
"""Figures of a plan that is not judged yet. With one frame it counts as one that is smoothed."""
VERIFIED: Final = "verified"


def count_plans(tried: Sequence[Attempt], choice: Portfolio) -> tuple[int, int]:
    """Return the number of the last attempt's plan, from 1, and about how many there will be.

    Args:
        tried: The attempts so far; the last one is being computed.
        choice: What may be tried after them; the total is 0 if nothing follows a verified plan.
    """
    number = _plans(tried)
    if choice.improvements is None or not tried:
        return number, 0
    figures = next((each.figures for each in reversed(tried) if each.figures), ASSUMED)
    assumed = replace(tried[-1], status="straight", verdict=VERIFIED, figures=figures)
    ahead = [*tried[:-1], assumed]
    while attempts.following(ahead, choice) == "explode" and (todo := choice.after(ahead)):
        ahead.append(replace(assumed, todo=todo, finer=1, between=False))
    return number, _plans(ahead)


def with_count(report: Report, tried: Sequence[Attempt], choice: Portfolio) -> Report:
    """Return a report that adds the plan's number and the total; the same without a preference."""
    number, total = count_plans(tried, choice)
    if not total:
        return report
    return lambda progress: report(replace(progress, plan=number, plans=total))


def _plans(tried: Sequence[Attempt]) -> int:
    """Return the number of explosions and smoothings; a finer playback is of the same plan."""
    return sum(attempt.finer == 1 for attempt in tried)
