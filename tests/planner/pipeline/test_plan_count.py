"""The number of the plan that is computed, and about how many there are."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from planner.pipeline.attempt import Attempt
from planner.pipeline.preference import PREFERENCES, Preference
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.search import REPEATED_PLAYBACK_REFINEMENT, count_plans, with_count
from planner.progress import Progress
from tests.planner.pipeline.test_improvements import choice, refused, tried_of, verified

BETTER: Sequence[Preference] = [each for each in PREFERENCES if each != "computing"]


@pytest.mark.parametrize("prefer", BETTER)
@pytest.mark.parametrize("paths", [1, 3])
def test_count_with_a_preference_is_the_number_of_plans_in_the_end(
    prefer: Preference, paths: int
) -> None:
    portfolio = choice(prefer, paths)
    tried = tried_of(portfolio)
    assert len(tried) > 3
    for number in range(1, len(tried) + 1):
        begun = Attempt(trial=tried[number - 1].trial, status="begun")
        assert count_plans([*tried[: number - 1], begun], portfolio) == (number, len(tried))


def test_count_after_a_refused_plan_goes_on() -> None:
    portfolio = choice("time", 2)
    first = refused(portfolio.next_attempt([]) or pytest.fail())
    trial = portfolio.next_attempt([first])
    assert trial is not None
    number, total = count_plans([first, Attempt(trial=trial, status="begun")], portfolio)
    assert number == 2
    rest = tried_of(portfolio)
    assert 2 < total <= len(rest) + 1


def test_count_of_plans_ignores_a_finer_playback() -> None:
    portfolio = choice("time")
    tried = tried_of(portfolio)[:2]
    finer = Attempt(trial=tried[-1].trial, status="straight", finer=REPEATED_PLAYBACK_REFINEMENT)
    assert count_plans([*tried, finer], portfolio)[0] == 2


def test_report_without_a_preference_counts_nothing() -> None:
    told: list[Progress] = []
    plain = RetryPolicy(strategies=(("peel",),), seed=5)
    trial = plain.next_attempt([])
    assert trial is not None
    with_count(told.append, [verified(trial)], plain)(Progress(stage="certify", fraction=0.5))
    portfolio = choice("time")
    with_count(told.append, [verified(trial)], portfolio)(Progress(stage="certify", fraction=0.5))
    assert [(each.plan, each.plans > 1) for each in told] == [(0, False), (1, True)]
