"""Attempts after the first verified plan for a preference, and the choice of the best."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from foldback.planner.errors import InputError
from foldback.planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, AttemptSpec, Candidates
from foldback.planner.pipeline.improvements import Improvements, best_of, expected_seconds_of
from foldback.planner.pipeline.next_step import (
    REPEATED_PLAYBACK_REFINEMENT,
    Explode,
    count_plans,
    next_step,
    with_count,
)
from foldback.planner.pipeline.preference import PREFERENCES, PlanFigures, Preference
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.progress import Progress
from foldback.planner.reasons import Reason, ReasonCode
from tests.planner.chains import chain_of

ALL = ("simultaneous", "blocks", "peel")
REFUSAL = Reason.of(ReasonCode.PLAN_END)
FIGURES = PlanFigures(
    fold_time_s=10.0, peak_torque_nm=0.1, clearance_bound=0.04, frames=100, seconds=1.0
)


def verified(spec: AttemptSpec, **figures: float | None) -> Attempt:
    return Attempt(
        spec=spec,
        status="straight",
        played=True,
        verified=True,
        figures=replace(FIGURES, **figures),
    )


def refused(spec: AttemptSpec) -> Attempt:
    return Attempt(
        spec=spec,
        status="straight",
        played=True,
        verified=False,
        refusal=REFUSAL,
        figures=FIGURES,
    )


def choice(prefer: Preference, paths: int = 1, **policy_options: int) -> RetryPolicy:
    wished = {"modules": 64, "max_frames": 1000, **policy_options}
    return RetryPolicy(
        strategies=(("simultaneous", "peel"),) * paths,
        seed=5,
        improvements=Improvements(prefer=prefer, strategies=(ALL,) * paths, **wished),
    )


def attempts(
    portfolio: RetryPolicy, outcome_of: Callable[[AttemptSpec], Attempt] = verified
) -> Sequence[Attempt]:
    """Return all attempts if each ends as ``outcome_of`` says."""
    tried_attempts: list[Attempt] = []
    while isinstance(step := next_step(tried_attempts, portfolio), Explode):
        tried_attempts.append(outcome_of(step.spec))
    return tried_attempts


def test_first_verified_plan_ends_a_search_for_least_computing() -> None:
    for portfolio in (choice("computing"), RetryPolicy(strategies=(ALL,), seed=5)):
        assert [attempt.spec for attempt in attempts(portfolio)] == [
            AttemptSpec(0, 5, "simultaneous")
        ]


def test_other_strategies_and_paths_come_first_then_smoothings() -> None:
    quick = {"simultaneous": 5.0, "blocks": 3.0, "peel": 9.0, "smoothed": 2.0}

    def outcome_of(spec: AttemptSpec) -> Attempt:
        return verified(spec, fold_time_s=quick[spec.strategy] - 0.1 * spec.candidate)

    assert [attempt.spec for attempt in attempts(choice("time", paths=2), outcome_of)] == [
        *(AttemptSpec(0, 5, name) for name in ALL),
        AttemptSpec(1, 5, "blocks"),
        AttemptSpec(1, 5, "smoothed", smooths=3),
        AttemptSpec(0, 5, "smoothed", smooths=0),
        AttemptSpec(1, 6, "smoothed", smooths=3),
        AttemptSpec(1, 7, "smoothed", smooths=3),
    ]


def test_refused_smoothings_are_softened_up_to_a_limit() -> None:
    def outcome_of(spec: AttemptSpec) -> Attempt:
        return refused(spec) if spec.smooths is not None else verified(spec)

    tried_specs = [attempt.spec for attempt in attempts(choice("torque", paths=4), outcome_of)]
    assert len([spec for spec in tried_specs if spec.smooths is None]) == MAX_EXPLOSIONS
    assert [(spec.strategy, spec.smooths) for spec in tried_specs[MAX_EXPLOSIONS:]] == [
        *(("smoothed", 0), ("softened", 0)),
        *(("smoothed", 1), ("softened", 1)),
    ]
    assert len(set(tried_specs)) == len(tried_specs)


def test_long_motions_are_not_smoothed_and_expensive_attempts_not_made() -> None:
    assert not [a for a in attempts(choice("time", max_frames=99)) if a.spec.smooths is not None]
    # There are at most two dozen blocks, regardless of the chain's length.
    for modules, other_methods in ((4000, ["blocks", "peel"]), (9600, ["peel"])):
        tried_specs = [attempt.spec for attempt in attempts(choice("time", modules=modules))]
        assert [spec.strategy for spec in tried_specs] == ["simultaneous", *other_methods]
        expected_s = [expected_seconds_of(spec, modules) for spec in tried_specs]
        assert expected_s[0] > 300.0 > sum(expected_s[1:])


def test_preference_changes_nothing_before_a_verified_plan() -> None:
    tried_attempts = attempts(choice("clearance", paths=2), refused)
    plain = attempts(replace(choice("clearance", paths=2), improvements=None), refused)
    assert [attempt.spec for attempt in tried_attempts] == [attempt.spec for attempt in plain]


def test_smoothings_are_not_in_the_lookahead() -> None:
    portfolio = choice("time")
    tried_attempts = [verified(AttemptSpec(0, 5, name)) for name in ALL]
    ahead = portfolio.lookahead(tried_attempts[:1], AttemptSpec(0, 5, "blocks"))
    assert ahead == [AttemptSpec(0, 5, "peel")]
    assert portfolio.lookahead(tried_attempts[:2], AttemptSpec(0, 5, "peel")) == []


def test_best_plan_by_each_preference() -> None:
    """A slow plan needs little torque; a plan as fast as the others may need the most."""
    spec = AttemptSpec(0, 5, "peel")
    tried_attempts = [
        verified(spec),
        verified(spec, fold_time_s=2.0, peak_torque_nm=50.0),
        verified(spec, fold_time_s=20.0, peak_torque_nm=0.01, clearance_bound=0.01),
        verified(spec, fold_time_s=100.0, peak_torque_nm=0.009, clearance_bound=0.05),
        verified(spec, fold_time_s=None, peak_torque_nm=None, clearance_bound=None),
        refused(spec),
    ]
    best: dict[Preference, int] = {"computing": 0, "time": 1, "torque": 2, "clearance": 3}
    for prefer, number in best.items():
        assert best_of(tried_attempts, prefer) == number
        assert best_of([*tried_attempts, *tried_attempts], prefer) == number, (
            "of equal ones the earlier"
        )
        assert best_of([refused(spec)], prefer) is None


def test_calmest_plan_and_where_turns_are_tried() -> None:
    """Half the hinges at once are worth a quarter more travel, but not twice the reversals."""
    spec = AttemptSpec(0, 5, "simultaneous")
    motions = (
        (1.2, 80.0, 0.0),
        (1.5, 40.0, 0.1),
        (1.4, 40.0, 1.0),
        (1.0, 90.0, 0.0),
        (None, 1.0, 0.0),
        (1.0, None, 0.0),
        (1.0, 1.0, None),
    )
    tried_attempts = [
        verified(spec, travel_ratio=travel, hinges_moving_mean=moving, reversals_mean=reversals)
        for travel, moving, reversals in motions
    ]
    assert best_of(tried_attempts, "calm") == 1
    chains = Candidates((chain_of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),), two_ended=False)
    for prefer, strategy, expected in (
        ("calm", "auto", ("turns", *ALL)),
        ("time", "auto", ALL),
        ("calm", "peel", ("peel",)),
    ):
        policy = RetryPolicy.of(FoldRequest.of(prefer=prefer, strategy=strategy), chains)
        assert policy.improvements is not None
        assert policy.improvements.strategies == (expected,)


def test_turns_are_not_smoothed_for_the_calmest_motion() -> None:
    preferences: tuple[tuple[Preference, set[str]], ...] = (
        ("calm", {"simultaneous", "peel"}),
        ("time", {"simultaneous", "turns"}),
    )
    for prefer, smoothed in preferences:
        policy = choice(prefer)
        assert policy.improvements is not None
        more_strategies = replace(policy.improvements, strategies=(("turns", "peel"),))
        tried_specs = [
            attempt.spec for attempt in attempts(replace(policy, improvements=more_strategies))
        ]
        originals = [tried_specs[spec.smooths] for spec in tried_specs if spec.smooths is not None]
        assert {spec.strategy for spec in originals} == smoothed


def test_preference_is_refused_if_there_is_one_plan() -> None:
    with pytest.raises(InputError, match="got the preference 'speed', expected one of: computing"):
        FoldRequest.of(prefer="speed").check()
    for form_options in ({"preset": "paper"}, {"smooth": True}, {"strategy": "one-by-one"}):
        with pytest.raises(
            InputError, match="preference .time., .* gives only one plan"
        ) as refusal:
            FoldRequest.of(prefer="time", **form_options).check()
        assert (refusal.value.code, refusal.value.where) == ("unsuited-prefer", "prefer")
    for prefer in PREFERENCES:
        FoldRequest(prefer=prefer, strategy="peel").check()


BETTER: Sequence[Preference] = [
    preference for preference in PREFERENCES if preference != "computing"
]


@pytest.mark.parametrize("prefer", BETTER)
@pytest.mark.parametrize("paths", [1, 3])
def test_count_with_a_preference_is_the_number_of_plans_in_the_end(
    prefer: Preference, paths: int
) -> None:
    portfolio = choice(prefer, paths)
    tried_attempts = attempts(portfolio)
    assert len(tried_attempts) > 3
    for number in range(1, len(tried_attempts) + 1):
        started = Attempt(spec=tried_attempts[number - 1].spec, status="begun")
        assert count_plans([*tried_attempts[: number - 1], started], portfolio) == (
            number,
            len(tried_attempts),
        )


def test_count_of_plans_ignores_a_finer_playback() -> None:
    portfolio = choice("time")
    tried_attempts = attempts(portfolio)[:2]
    finer = Attempt(
        spec=tried_attempts[-1].spec, status="straight", finer=REPEATED_PLAYBACK_REFINEMENT
    )
    assert count_plans([*tried_attempts, finer], portfolio)[0] == 2


def test_report_without_a_preference_counts_nothing() -> None:
    progress_reports: list[Progress] = []
    plain = RetryPolicy(strategies=(("peel",),), seed=5)
    spec = plain.next_attempt([])
    assert spec is not None
    with_count(progress_reports.append, [verified(spec)], plain)(
        Progress(stage="certify", fraction=0.5)
    )
    portfolio = choice("time")
    with_count(progress_reports.append, [verified(spec)], portfolio)(
        Progress(stage="certify", fraction=0.5)
    )
    assert [(progress.plan, progress.plans > 1) for progress in progress_reports] == [
        (0, False),
        (1, True),
    ]
