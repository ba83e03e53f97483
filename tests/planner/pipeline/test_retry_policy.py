"""Order of attempts, and the selection of the failure that is shown."""

import json
from dataclasses import replace

import numpy as np

from foldback.planner.explosion.diagnosis import Diagnosis
from foldback.planner.pipeline.attempt import (
    MAX_EXPLOSIONS,
    Attempt,
    AttemptSpec,
    Candidates,
    Cause,
    latest_playback,
)
from foldback.planner.pipeline.improvements import Improvements
from foldback.planner.pipeline.next_step import (
    MAX_PATIENCE,
    MAX_PLAYBACKS_BEFORE_VERIFIED,
    MAX_REFUSED_EXPLOSIONS,
    REPEATED_PLAYBACK_REFINEMENT,
    Certify,
    Explode,
    PlayBack,
    before_explosion,
    before_playback,
    next_step,
    with_choice,
)
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.reasons import Reason, ReasonCode
from tests.case import case
from tests.planner.chains import coil
from tests.planner.peels import snake
from tests.planner.pipeline.test_improvements import FIGURES, REFUSAL

BOTH = ("simultaneous", "peel")


def specs(choice: RetryPolicy, kind: Cause) -> list[AttemptSpec]:
    """Return all attempts if every one fails for the same reason."""
    tried_attempts: list[Attempt] = []
    while (spec := choice.next_attempt(tried_attempts)) is not None:
        if kind == "refused":
            tried_attempts.append(
                Attempt(spec=spec, status="straight", verified=False, refusal=REFUSAL)
            )
        else:
            diagnosis = Diagnosis(kind=kind, modules=())
            tried_attempts.append(Attempt(spec=spec, status="stalled", diagnosis=diagnosis))
    return [attempt.spec for attempt in tried_attempts]


def test_attempt_survives_json() -> None:
    started = Attempt(spec=AttemptSpec(1, 2, "peel", other_end=True, gentle=True), status="begun")
    plain = Attempt(spec=AttemptSpec(0, 0, "simultaneous", plain=True), status="begun")
    refused = replace(started, status="straight", steps=5, finer=4, played=True, between=True)
    diagnosis = Diagnosis(kind="knot", modules=(3, 4))
    for attempt in (
        started,
        plain,
        replace(refused, verified=False, refusal=REFUSAL),
        replace(
            started,
            status="stalled",
            reason=Reason.of(ReasonCode.AT_REST, steps=1),
            diagnosis=diagnosis,
        ),
    ):
        assert Attempt.from_dict(json.loads(json.dumps(attempt.as_dict()))) == attempt


def test_reason_of_a_failure_decides_the_next_attempt() -> None:
    choice = RetryPolicy(strategies=(BOTH, BOTH), seed=5)
    assert specs(choice, "joints") == [
        AttemptSpec(0, 5, "simultaneous"),
        AttemptSpec(1, 5, "simultaneous"),
        AttemptSpec(1, 5, "peel"),
        AttemptSpec(0, 5, "peel"),
        AttemptSpec(0, 6, "peel"),
        AttemptSpec(1, 6, "peel"),
    ]
    assert specs(choice, "contacts")[:3] == [
        AttemptSpec(0, 5, "simultaneous"),
        AttemptSpec(0, 5, "peel"),
        AttemptSpec(1, 5, "peel"),
    ]
    # Another seed cannot untie a knot.
    assert {spec.seed for spec in specs(choice, "knot")} == {5}
    assert specs(RetryPolicy(strategies=(("simultaneous",),), seed=2**32 - 1), "refused") == [
        AttemptSpec(0, seed, "simultaneous") for seed in (2**32 - 1, 0, 1)
    ]


def test_attempts_end_and_none_is_made_twice() -> None:
    choice = RetryPolicy(strategies=(BOTH, ("peel",), BOTH), seed=0)
    kinds: tuple[Cause, ...] = ("knot", "buried", "contacts", "joints", "limit", "refused")
    for kind in kinds:
        tried_specs = specs(choice, kind)
        assert 1 < len(tried_specs) <= MAX_EXPLOSIONS, kind
        assert len(set(tried_specs)) == len(tried_specs), kind
        assert all(spec.strategy in choice.strategies[spec.candidate] for spec in tried_specs), kind


def test_plain_explosions_follow_a_calm_one() -> None:
    """What was tried before explosions were calm is still tried, except the last attempt."""
    calm, plain = (
        RetryPolicy(strategies=(BOTH, BOTH), seed=5, calm=calm) for calm in (True, False)
    )
    kinds: tuple[Cause, ...] = ("knot", "buried", "contacts", "joints", "limit", "refused")
    for kind in kinds:
        first, *other_specs = specs(calm, kind)
        usual = specs(plain, kind)
        assert first == AttemptSpec(0, 5, "simultaneous")
        expected = [replace(spec, plain=spec.strategy == "simultaneous") for spec in usual]
        assert other_specs == expected[: MAX_EXPLOSIONS - 1], kind
    assert "plain" not in Attempt(spec=first, status="begun").as_dict()
    request, chains = FoldRequest(), Candidates((coil(12),), two_ended=False)
    assert RetryPolicy.of(request, chains).calm
    assert not RetryPolicy.of(replace(request, strategy="simultaneous"), chains).calm
    assert not RetryPolicy.of(replace(request, preset="paper"), chains).calm


def test_turns_with_the_most_room_come_before_all_explosions() -> None:
    """A search in vain takes no attempt from the explosions."""
    request, short = FoldRequest(seed=3), Candidates((snake((4, 4, 4)),), two_ended=False)
    policy = RetryPolicy.of(request, short)
    roomy = AttemptSpec(0, 3, "turns", roomy=True)
    kinds: tuple[Cause, ...] = ("blocked", "limit", "joints", "refused")
    for kind in kinds:
        first, *other_specs = specs(policy, kind)
        assert first == roomy
        assert "turns" not in policy.strategies[0]
        usual = specs(replace(policy, turns=False), kind)
        assert other_specs == (usual if kind != "blocked" else usual[:1])
    straight = Attempt(spec=roomy, status="straight", verified=True)
    assert policy.next_attempt([straight]) is None
    assert Attempt.from_dict(json.loads(json.dumps(straight.as_dict()))).spec == roomy


def test_only_auto_without_a_preference_takes_turns_for_short_chains_of_usual_size() -> None:
    usual = FoldRequest()
    short, long = ((snake(sides),) for sides in ((4, 4, 4), (1, 1, 65)))
    for request, chains in (
        (usual, long),
        (replace(usual, strategy="simultaneous"), short),
        (replace(usual, prefer="time"), short),
        (replace(usual, module_size=0.9), short),
        (replace(usual, preset="paper"), short),
        (replace(usual, preset="direct"), short),
        (replace(usual, world="table"), short),
        (replace(usual, refold=True), short),
    ):
        assert not RetryPolicy.of(request, Candidates(chains, two_ended=False)).turns


def test_attempts_from_the_other_end_and_gentle_ones_depend_on_the_strategy() -> None:
    buried = RetryPolicy(strategies=(("peel", "blocks"),), seed=0, two_ended=True)
    assert specs(buried, "buried")[:3] == [
        AttemptSpec(0, 0, "peel"),
        AttemptSpec(0, 0, "peel", other_end=True),
        AttemptSpec(0, 0, "blocks", other_end=True),
    ]
    # Blocks and simultaneous explosions have no first end.
    two_ended = RetryPolicy(strategies=(("blocks", "simultaneous"),), seed=0, two_ended=True)
    assert not any(spec.other_end for spec in specs(two_ended, "buried"))
    forces = RetryPolicy(strategies=(BOTH,), seed=0, forces=True)
    assert specs(forces, "contacts")[1] == AttemptSpec(0, 0, "simultaneous", gentle=True)
    assert specs(forces, "refused")[3] == AttemptSpec(0, 2, "peel")
    alone = RetryPolicy(strategies=(("simultaneous",),), seed=0, forces=True)
    assert specs(alone, "refused")[3] == AttemptSpec(0, 2, "simultaneous", gentle=True)
    # A search for turns has neither forces nor a first end.
    for strategy in ("turns", "one-by-one"):
        search = RetryPolicy(strategies=((strategy,),), seed=0, two_ended=True, forces=True)
        for kind in ("contacts", "joints"):
            assert specs(search, kind) == [AttemptSpec(0, seed, strategy) for seed in range(3)]


def test_a_search_for_turns_that_is_blocked_is_repeated_only_for_other_paths() -> None:
    alone = RetryPolicy(strategies=(("one-by-one",),), seed=0, two_ended=True, forces=True)
    assert specs(alone, "blocked") == [AttemptSpec(0, 0, "one-by-one")]
    two = replace(alone, strategies=(("one-by-one",), ("one-by-one",)))
    assert specs(two, "blocked") == [
        AttemptSpec(0, 0, "one-by-one"),
        AttemptSpec(1, 0, "one-by-one"),
    ]


def test_chain_from_its_other_end_fills_the_same_cells() -> None:
    box = snake((3, 3, 4))
    other_box = box.from_other_end()
    assert (other_box.name, other_box.pitch_m, other_box.module) == (
        box.name,
        box.pitch_m,
        box.module,
    )
    np.testing.assert_allclose(
        other_box.folded_poses.positions, box.folded_poses.positions[::-1], atol=1e-12
    )


POLICY = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=0)
ONE = RetryPolicy(strategies=(("simultaneous",),), seed=0, seeds=1)
PUBLISHED = replace(POLICY, retries_refused=False)
MORE = replace(
    POLICY,
    improvements=Improvements(
        prefer="time", strategies=(("simultaneous", "peel"),), modules=64, max_frames=1000
    ),
)
FIRST = AttemptSpec(0, 0, "simultaneous")
SECOND = AttemptSpec(0, 1, "simultaneous")
PEELED = AttemptSpec(0, 0, "peel")

STRAIGHT = Attempt(spec=FIRST, status="straight")
PLAYED = replace(STRAIGHT, played=True)
REFUSED = replace(PLAYED, verified=False, refusal=REFUSAL)
BETWEEN = replace(REFUSED, between=True)
SWINGING = replace(REFUSED, off_straight=True)
AGAIN = replace(BETWEEN, finer=REPEATED_PLAYBACK_REFINEMENT)
VERIFIED = replace(PLAYED, verified=True, figures=FIGURES)
FINER = PlayBack(REPEATED_PLAYBACK_REFINEMENT)
STALLED = Attempt(spec=FIRST, status="stalled")
SHOWN = replace(STALLED, played=True)
JUDGED = replace(SHOWN, verified=False, refusal=REFUSAL)
NOTHING = Attempt(spec=FIRST, status="none")


def test_next_step_of_a_history() -> None:
    for policy, history, step in (
        (POLICY, [], Explode(FIRST)),
        (POLICY, [STALLED], Explode(PEELED)),
        (POLICY, [replace(STALLED, status="cancelled")], PlayBack()),
        (ONE, [STALLED], PlayBack()),
        (ONE, [SHOWN], Certify()),
        (ONE, [JUDGED], None),
        (ONE, [JUDGED, replace(STALLED, spec=SECOND)], None),
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
        (POLICY, [SWINGING], PlayBack(patience=1)),
        (POLICY, [SWINGING, replace(STRAIGHT, patience=1)], PlayBack(patience=1)),
        (POLICY, [SWINGING, replace(SWINGING, patience=1)], PlayBack(patience=2)),
        (POLICY, [SWINGING, replace(SWINGING, patience=MAX_PATIENCE)], None),
        (POLICY, [SWINGING, replace(REFUSED, patience=1)], Explode(SECOND)),
        (POLICY, [SWINGING, replace(BETWEEN, patience=1)], replace(FINER, patience=1)),
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
    ):
        with case((policy, history)):
            assert next_step(history, policy) == step


def test_explosions_run_again_after_the_last_verdict() -> None:
    for history, kept_attempts in (
        ([], 0),
        ([replace(STALLED, status="begun")], 0),
        ([STALLED, STRAIGHT], 0),
        ([REFUSED], 1),
        ([REFUSED, STALLED, STRAIGHT], 1),
        ([BETWEEN], 0),
        ([BETWEEN, AGAIN], 2),
        ([VERIFIED], 0),
        ([JUDGED, STALLED], 0),
    ):
        with case((history, kept_attempts)):
            assert before_explosion(history, POLICY) == tuple(history[:kept_attempts])


def test_playback_run_again_has_no_verdict() -> None:
    for history, before in (
        ([], []),
        ([STRAIGHT], [STRAIGHT]),
        ([VERIFIED], [STRAIGHT]),
        ([REFUSED], [STRAIGHT]),
        ([BETWEEN], [BETWEEN, replace(STRAIGHT, finer=REPEATED_PLAYBACK_REFINEMENT)]),
        ([BETWEEN, AGAIN], [BETWEEN, replace(STRAIGHT, finer=REPEATED_PLAYBACK_REFINEMENT)]),
    ):
        with case((history, before)):
            diagnosis = before_playback(history, POLICY)
            assert diagnosis == tuple(before)
            assert before_playback(diagnosis, POLICY) == diagnosis


def test_choice_is_marked_at_the_latest_playback() -> None:
    history = (BETWEEN, AGAIN, replace(VERIFIED, spec=PEELED))
    assert [latest_playback(history, number) for number in (0, 2)] == [1, 2]
    assert [attempt.chosen for attempt in with_choice(history, 0)] == [False, True, False]
    assert [attempt.chosen for attempt in with_choice(history, 2)] == [False, False, True]


def test_published_recipes_and_baselines_have_one_attempt() -> None:
    for values, retries in (
        ({}, True),
        ({"smooth": True}, True),
        ({"strategy": "one-by-one"}, False),
        ({"preset": "paper"}, False),
        ({"preset": "direct"}, False),
    ):
        with case((values, retries)):
            candidates = Candidates((coil(8),), two_ended=False)
            assert RetryPolicy.of(FoldRequest(**values), candidates).retries_refused == retries
