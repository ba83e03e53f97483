"""The next step of a fold, by the outcomes so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from planner.pipeline.attempt import Attempt, Candidates, Trial, latest_playback
from planner.pipeline.improvements import Improvements
from planner.pipeline.preference import PlanFigures
from planner.pipeline.request import FoldRequest
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.search import (
    MAX_PLAYBACKS_BEFORE_VERIFIED,
    MAX_REFUSED_EXPLOSIONS,
    REPEATED_PLAYBACK_REFINEMENT,
    Certify,
    Explode,
    PlayBack,
    Step,
    before_explosion,
    before_playback,
    next_step,
    with_choice,
)
from tests.planner.chains import coil

POLICY = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=0)
ONE = RetryPolicy(strategies=(("simultaneous",),), seed=0, seeds=1)
PUBLISHED = replace(POLICY, retries_refused=False)
MORE = replace(
    POLICY,
    improvements=Improvements(
        prefer="time", strategies=(("simultaneous", "peel"),), modules=64, most_frames=1000
    ),
)
FIGURES = PlanFigures(
    fold_time_s=10.0, peak_torque_nm=0.1, clearance_bound=0.04, frames=100, seconds=1.0
)
FIRST = Trial(0, 0, "simultaneous")
SECOND = Trial(0, 1, "simultaneous")
PEELED = Trial(0, 0, "peel")

STRAIGHT = Attempt(trial=FIRST, status="straight")
PLAYED = replace(STRAIGHT, played=True)
REFUSED = replace(PLAYED, verdict="failed: modules 1 and 9 overlap")
BETWEEN = replace(REFUSED, between=True)
AGAIN = replace(BETWEEN, finer=REPEATED_PLAYBACK_REFINEMENT)
VERIFIED = replace(PLAYED, verdict="verified (simulated)", figures=FIGURES)
FINER = PlayBack(REPEATED_PLAYBACK_REFINEMENT)
STALLED = Attempt(trial=FIRST, status="stalled")
SHOWN = replace(STALLED, played=True)
JUDGED = replace(SHOWN, verdict="failed: the explosion stalled")
NOTHING = Attempt(trial=FIRST, status="none")


@pytest.mark.parametrize(
    ("policy", "history", "step"),
    [
        (POLICY, [], Explode(FIRST)),
        (POLICY, [STALLED], Explode(PEELED)),
        (POLICY, [replace(STALLED, status="cancelled")], PlayBack()),
        (ONE, [STALLED], PlayBack()),
        (ONE, [SHOWN], Certify()),
        (ONE, [JUDGED], None),
        (ONE, [JUDGED, replace(STALLED, trial=SECOND)], None),
        (ONE, [REFUSED, STALLED], PlayBack()),
        (ONE, [REFUSED, SHOWN], Certify()),
        (POLICY, [STALLED, STRAIGHT], PlayBack()),
        (POLICY, [STRAIGHT], PlayBack()),
        (POLICY, [PLAYED], Certify()),
        (POLICY, [VERIFIED], None),
        (MORE, [VERIFIED], Explode(PEELED)),
        (POLICY, [REFUSED], Explode(SECOND)),
        (POLICY, [BETWEEN], FINER),
        (POLICY, [BETWEEN, replace(STRAIGHT, finer=REPEATED_PLAYBACK_REFINEMENT)], FINER),
        (POLICY, [BETWEEN, replace(PLAYED, finer=REPEATED_PLAYBACK_REFINEMENT)], Certify()),
        (POLICY, [BETWEEN, AGAIN], Explode(SECOND)),
        (POLICY, [replace(REFUSED, unfolding_overlaps=True)], None),
        (POLICY, [replace(BETWEEN, unfolding_overlaps=True)], FINER),
        (POLICY, [REFUSED] * MAX_REFUSED_EXPLOSIONS, None),
        (POLICY, [BETWEEN] * (MAX_PLAYBACKS_BEFORE_VERIFIED - 1), FINER),
        (POLICY, [BETWEEN] * MAX_PLAYBACKS_BEFORE_VERIFIED, None),
        (PUBLISHED, [STALLED], Explode(PEELED)),
        (PUBLISHED, [REFUSED], None),
        (PUBLISHED, [BETWEEN], None),
        (PUBLISHED, [NOTHING], PlayBack()),
        (PUBLISHED, [replace(NOTHING, played=True)], Certify()),
        (PUBLISHED, [replace(REFUSED, status="none")], None),
        (POLICY, [replace(REFUSED, status="none")], None),
    ],
)
def test_next_step_of_a_history(
    policy: RetryPolicy, history: Sequence[Attempt], step: Step | None
) -> None:
    assert next_step(history, policy) == step


@pytest.mark.parametrize(
    ("history", "kept"),
    [
        ([], 0),
        ([replace(STALLED, status="begun")], 0),
        ([STALLED, STRAIGHT], 0),
        ([REFUSED], 1),
        ([REFUSED, STALLED, STRAIGHT], 1),
        ([BETWEEN], 0),
        ([BETWEEN, AGAIN], 2),
        ([VERIFIED], 0),
        ([JUDGED, STALLED], 0),
    ],
)
def test_explosions_run_again_after_the_last_verdict(history: Sequence[Attempt], kept: int) -> None:
    assert before_explosion(history, POLICY) == tuple(history[:kept])


@pytest.mark.parametrize(
    ("history", "before"),
    [
        ([], []),
        ([STRAIGHT], [STRAIGHT]),
        ([VERIFIED], [STRAIGHT]),
        ([REFUSED], [STRAIGHT]),
        ([BETWEEN], [BETWEEN, replace(STRAIGHT, finer=REPEATED_PLAYBACK_REFINEMENT)]),
        ([BETWEEN, AGAIN], [BETWEEN, replace(STRAIGHT, finer=REPEATED_PLAYBACK_REFINEMENT)]),
    ],
)
def test_playback_run_again_has_no_verdict(
    history: Sequence[Attempt], before: Sequence[Attempt]
) -> None:
    found = before_playback(history, POLICY)
    assert found == tuple(before)
    assert before_playback(found, POLICY) == found


def test_choice_is_marked_at_the_latest_playback() -> None:
    history = (BETWEEN, AGAIN, replace(VERIFIED, trial=PEELED))
    assert [latest_playback(history, number) for number in (0, 2)] == [1, 2]
    assert [each.chosen for each in with_choice(history, 0)] == [False, True, False]
    assert [each.chosen for each in with_choice(history, 2)] == [False, False, True]


@pytest.mark.parametrize(
    ("values", "retries"),
    [
        ({}, True),
        ({"smooth": True}, True),
        ({"strategy": "one-by-one"}, False),
        ({"preset": "paper"}, False),
        ({"preset": "direct"}, False),
    ],
)
def test_published_recipes_and_baselines_have_one_attempt(
    values: dict[str, Any], retries: bool
) -> None:
    candidates = Candidates((coil(8),), two_ended=False)
    assert RetryPolicy.of(FoldRequest(**values), candidates).retries_refused == retries
