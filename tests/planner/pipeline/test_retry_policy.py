"""Order of attempts, and the failure that is shown of several."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.explosion.diagnosis import Diagnosis, diagnose
from planner.explosion.simultaneous import explode
from planner.motion.motion import Motion
from planner.motion.record import Record, Spent
from planner.motion.timeline import Timeline
from planner.parameters.explosion import ExplosionParameters
from planner.parameters.parameters import Parameters
from planner.pipeline.attempt import (
    MAX_EXPLOSIONS,
    Attempt,
    Candidates,
    Reason,
    Trial,
    latest_playback,
)
from planner.pipeline.improvements import Improvements
from planner.pipeline.next_step import (
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
from planner.pipeline.preference import PlanFigures
from planner.pipeline.request import FoldRequest
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.stages import run_stages
from planner.plan.plan import Plan
from planner.plan.shape_writers import write_path
from tests.planner.chains import SQUARE, coil
from tests.planner.folds import write_request
from tests.planner.peels import snake

BOTH = ("simultaneous", "peel")


def trials(choice: RetryPolicy, kind: Reason) -> list[Trial]:
    """Return all attempts if every one fails for the same reason."""
    tried: list[Attempt] = []
    while (trial := choice.next_attempt(tried)) is not None:
        if kind == "refused":
            tried.append(Attempt(trial=trial, status="straight", verdict="failed: it"))
        else:
            found = Diagnosis(kind=kind, modules=())
            tried.append(Attempt(trial=trial, status="stalled", diagnosis=found))
    return [attempt.trial for attempt in tried]


def test_attempt_survives_json() -> None:
    started = Attempt(trial=Trial(1, 2, "peel", other_end=True, gentle=True), status="begun")
    refused = replace(started, status="straight", steps=5, finer=4, played=True, between=True)
    found = Diagnosis(kind="knot", modules=(3, 4))
    for attempt in (
        started,
        replace(refused, verdict="failed: …"),
        replace(started, status="stalled", reason="stuck", diagnosis=found),
    ):
        assert Attempt.from_dict(json.loads(json.dumps(attempt.as_dict()))) == attempt


def test_reason_of_a_failure_decides_the_next_attempt() -> None:
    choice = RetryPolicy(strategies=(BOTH, BOTH), seed=5)
    assert trials(choice, "joints") == [
        Trial(0, 5, "simultaneous"),
        Trial(1, 5, "simultaneous"),
        Trial(1, 5, "peel"),
        Trial(0, 5, "peel"),
        Trial(0, 6, "peel"),
        Trial(1, 6, "peel"),
    ]
    assert trials(choice, "contacts")[:3] == [
        Trial(0, 5, "simultaneous"),
        Trial(0, 5, "peel"),
        Trial(1, 5, "peel"),
    ]
    # Another seed does not open a knot.
    assert {found.seed for found in trials(choice, "knot")} == {5}
    assert trials(RetryPolicy(strategies=(("simultaneous",),), seed=2**32 - 1), "refused") == [
        Trial(0, seed, "simultaneous") for seed in (2**32 - 1, 0, 1)
    ]


def test_attempts_end_and_none_is_made_twice() -> None:
    choice = RetryPolicy(strategies=(BOTH, ("peel",), BOTH), seed=0)
    kinds: tuple[Reason, ...] = ("knot", "buried", "contacts", "joints", "limit", "refused")
    for kind in kinds:
        tried = trials(choice, kind)
        assert 1 < len(tried) <= MAX_EXPLOSIONS, kind
        assert len(set(tried)) == len(tried), kind
        assert all(found.strategy in choice.strategies[found.candidate] for found in tried), kind


def test_attempts_from_the_other_end_and_gentle_ones_depend_on_the_strategy() -> None:
    buried = RetryPolicy(strategies=(("peel", "blocks"),), seed=0, two_ended=True)
    assert trials(buried, "buried")[:3] == [
        Trial(0, 0, "peel"),
        Trial(0, 0, "peel", other_end=True),
        Trial(0, 0, "blocks", other_end=True),
    ]
    # Blocks and simultaneous explosions have no first end.
    both = RetryPolicy(strategies=(("blocks", "simultaneous"),), seed=0, two_ended=True)
    assert not any(found.other_end for found in trials(both, "buried"))
    forces = RetryPolicy(strategies=(BOTH,), seed=0, forces=True)
    assert trials(forces, "contacts")[1] == Trial(0, 0, "simultaneous", gentle=True)
    assert trials(forces, "refused")[3] == Trial(0, 2, "peel")
    alone = RetryPolicy(strategies=(("simultaneous",),), seed=0, forces=True)
    assert trials(alone, "refused")[3] == Trial(0, 2, "simultaneous", gentle=True)
    # One-by-one plans do not depend on the seed.
    rows = RetryPolicy(strategies=(("peel", "one-by-one"),), seed=0, two_ended=True, forces=True)
    laid = [found for found in trials(rows, "buried") if found.strategy == "one-by-one"]
    assert {found.seed for found in laid} == {0}
    assert {found.other_end for found in laid} == {True, False}
    assert not any(found.gentle for found in laid)


def test_finer_frames_are_no_attempt_and_another_strategy_comes_last() -> None:
    choice = RetryPolicy(strategies=(BOTH,), seed=0, forces=True)
    first = Attempt(trial=Trial(0, 0, "simultaneous"), status="straight")
    for tried in ([first], [first, replace(first, finer=4)]):
        assert choice.next_attempt(tried) == Trial(0, 1, "simultaneous")
    tried = list[Attempt]()
    while isinstance(step := next_step(tried, choice), Explode):
        tried.append(Attempt(trial=step.trial, status="straight", played=True, verdict="failed: …"))
    assert [attempt.trial.strategy for attempt in tried] == ["simultaneous"] * 3 + ["peel"]


def test_chain_from_its_other_end_fills_the_same_cells() -> None:
    box = snake((3, 3, 4))
    other = box.from_other_end()
    assert (other.name, other.pitch_m, other.module) == (box.name, box.pitch_m, box.module)
    np.testing.assert_allclose(
        other.folded_poses.positions, box.folded_poses.positions[::-1], atol=1e-12
    )


def at_rest(chain: Chain, *, status: Any = "stalled", strategy: str = "simultaneous") -> Record:
    folded = chain.folded_poses
    frames = Motion.from_frames(
        phase="explosion",
        time_s=np.zeros(1),
        joint_angles_rad=chain.folded_rad[None],
        root_position=folded.positions[chain.root][None],
        root_wxyz=folded.wxyzs[chain.root][None],
    )
    return Record(
        status=status,
        reason="it is stuck",
        frames=frames,
        steps=1,
        seconds=0.1,
        strategy=strategy,
        spent=Spent("pushes", 40, 41),
    )


def finding(chain: Chain, record: Record) -> tuple[str, tuple[int, ...]] | None:
    """Return the kind of a diagnosis and the modules that it names."""
    found = diagnose(chain, record, Parameters())
    if found is not None:
        json.dumps(found.as_dict())
    return None if found is None else (found.kind, found.modules)


def test_diagnosis_names_the_kind_and_the_modules() -> None:
    box = snake((3, 3, 3))
    turns = np.abs(box.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    assert finding(box, at_rest(box)) == ("contacts", tuple((np.flatnonzero(turns) + 1).tolist()))
    found = diagnose(box, at_rest(box), Parameters())
    assert found is not None and "16 hinges were still bent, by up to 90°" in found.words
    assert finding(box, at_rest(box, status="straight")) is None
    assert finding(box, at_rest(box, status="cancelled")) is None
    steps = [(k, k, 0) for k in range(7)]
    stairs = Chain.from_path(
        Path.from_cells([cell for x, y, z in steps for cell in ((x, y, z), (x + 1, y, z))])
    )
    record = at_rest(stairs)
    for status, share, kind in (
        ("stalled", 1.0, "joints"),
        ("timeout", 0.0, "limit"),
        ("stalled", 0.5, "joints"),
        ("diverged", 0.5, "broken"),
        ("timeout", 0.5, "limit"),
    ):
        bent = record.frames.with_columns(joint_angles_rad=share * stairs.folded_rad[None])
        found = finding(stairs, replace(record, frames=bent, status=status))
        assert found is not None and found[0] == kind, (status, share)
        assert bool(found[1]) == (kind != "limit"), (status, share)


@pytest.mark.slow
def test_plan_holds_all_attempts_and_their_diagnoses(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stall_explosion(chain: Chain, *arguments: Any, **more: Any) -> Record:
        hasty = ExplosionParameters(max_steps=40)
        return replace(explode(chain, hasty, **more), status="stalled", reason="it sticks")

    monkeypatch.setattr("planner.explosion.strategies.explode", stall_explosion)
    failed = run_stages(write_request(tmp_path, write_path(SQUARE), strategy="simultaneous"))
    assert failed["status"] == "failed" and "it sticks" in failed["reason"]
    tried = Plan.load(tmp_path / "plan.npz").attempts
    assert len(tried) > 1
    assert failed["stuck"] in [attempt["diagnosis"] for attempt in tried]
    assert {attempt["status"] for attempt in tried} == {"stalled"}
    assert {attempt["strategy"] for attempt in tried} == {"simultaneous"}
    assert len(Timeline.open(tmp_path / "timeline.zarr")) > 0


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
