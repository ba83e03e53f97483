"""Order of attempts, and the failure shown among several."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.explosion.diagnosis import Diagnosis, diagnose
from planner.explosion.peeling import peel
from planner.explosion.simultaneous import explode
from planner.motion.motion import Motion
from planner.motion.record import Record, Spent
from planner.motion.timeline import Timeline
from planner.parameters.explosion import ExplosionParameters, PeelingParameters
from planner.parameters.parameters import Parameters
from planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, Reason, Trial
from planner.pipeline.request import FoldRequest
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.search import Explode, next_step
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_path
from tests.planner.peels import snake

BOTH = ("simultaneous", "peel")


def way(choice: RetryPolicy, kind: Reason) -> list[Trial]:
    """All that is tried when everything fails for one reason."""
    tried: list[Attempt] = []
    while (trial := choice.next_attempt(tried)) is not None:
        if kind == "refused":
            tried.append(Attempt(trial=trial, status="straight", verdict="failed: it"))
        else:
            found = Diagnosis(kind=kind, modules=())
            tried.append(Attempt(trial=trial, status="stalled", diagnosis=found))
    return [attempt.trial for attempt in tried]


@pytest.mark.parametrize(
    "attempt",
    [
        Attempt(trial=Trial(1, 2, "peel", other_end=True), status="begun"),
        Attempt(trial=Trial(0, 7, "blocks", gentle=True), status="straight", steps=5, finer=4),
        Attempt(
            trial=Trial(0, 0, "simultaneous"),
            status="straight",
            played=True,
            verdict="failed: …",
            between=True,
        ),
        Attempt(
            trial=Trial(0, 0, "simultaneous"),
            status="stalled",
            reason="stuck",
            diagnosis=Diagnosis(kind="knot", modules=(3, 4)),
        ),
    ],
)
def test_an_attempt_survives_json(attempt: Attempt) -> None:
    assert Attempt.from_dict(json.loads(json.dumps(attempt.as_dict()))) == attempt


def test_why_it_failed_decides_what_is_next() -> None:
    choice = RetryPolicy(strategies=(BOTH, BOTH), seed=5)
    assert way(choice, "joints") == [
        Trial(0, 5, "simultaneous"),
        Trial(1, 5, "simultaneous"),
        Trial(1, 5, "peel"),
        Trial(0, 5, "peel"),
        Trial(0, 6, "peel"),
        Trial(1, 6, "peel"),
    ]
    assert way(choice, "contacts")[:3] == [
        Trial(0, 5, "simultaneous"),
        Trial(0, 5, "peel"),
        Trial(1, 5, "peel"),
    ]
    # Another seed does not open a knot.
    assert {found.seed for found in way(choice, "knot")} == {5}
    assert way(RetryPolicy(strategies=(("simultaneous",),), seed=2**32 - 1), "refused") == [
        Trial(0, seed, "simultaneous") for seed in (2**32 - 1, 0, 1)
    ]


@pytest.mark.parametrize("kind", ["knot", "buried", "contacts", "joints", "limit", "refused"])
def test_it_ends_and_tries_nothing_twice(kind: Reason) -> None:
    choice = RetryPolicy(strategies=(BOTH, ("peel",), BOTH), seed=0)
    tried = way(choice, kind)
    assert 1 < len(tried) <= MAX_EXPLOSIONS
    assert len(set(tried)) == len(tried)
    assert all(found.strategy in choice.strategies[found.candidate] for found in tried)


def test_a_buried_unit_is_reached_from_the_other_end() -> None:
    choice = RetryPolicy(strategies=(("peel", "blocks"),), seed=0, two_ended=True)
    assert way(choice, "buried")[:3] == [
        Trial(0, 0, "peel"),
        Trial(0, 0, "peel", other_end=True),
        Trial(0, 0, "blocks", other_end=True),
    ]
    # Blocks and all at once begin at no end.
    both = RetryPolicy(strategies=(("blocks", "simultaneous"),), seed=0, two_ended=True)
    assert not any(found.other_end for found in way(both, "buried"))


def test_what_presses_too_hard_is_let_go_more_gently() -> None:
    choice = RetryPolicy(strategies=(BOTH,), seed=0, forces=True)
    assert way(choice, "contacts")[1] == Trial(0, 0, "simultaneous", gentle=True)
    assert way(choice, "refused")[3] == Trial(0, 2, "peel")
    alone = RetryPolicy(strategies=(("simultaneous",),), seed=0, forces=True)
    assert way(alone, "refused")[3] == Trial(0, 2, "simultaneous", gentle=True)


def test_a_chain_from_its_other_end_fills_the_same_cells() -> None:
    box = snake((3, 3, 4))
    other = box.from_other_end()
    assert (other.name, other.pitch_m, other.module) == (box.name, box.pitch_m, box.module)
    np.testing.assert_allclose(
        other.folded_poses.positions, box.folded_poses.positions[::-1], atol=1e-12
    )


def test_what_no_seed_changes_is_not_repeated_with_others() -> None:
    choice = RetryPolicy(strategies=(("peel", "one-by-one"),), seed=0, two_ended=True, forces=True)
    laid = [found for found in way(choice, "buried") if found.strategy == "one-by-one"]
    assert {found.seed for found in laid} == {0}
    assert {found.other_end for found in laid} == {True, False}
    assert not any(found.gentle for found in laid)


def test_another_strategy_is_tried_before_a_fold_is_given_up() -> None:
    choice = RetryPolicy(strategies=(BOTH,), seed=0, forces=True)
    tried: list[Attempt] = []
    while isinstance(step := next_step(tried, choice), Explode):
        tried.append(Attempt(trial=step.trial, status="straight", played=True, verdict="failed: …"))
    assert [attempt.trial.strategy for attempt in tried] == ["simultaneous"] * 3 + ["peel"]


def test_finer_frames_are_no_explosion() -> None:
    choice = RetryPolicy(strategies=(BOTH,), seed=0)
    first = Attempt(trial=Trial(0, 0, "simultaneous"), status="straight")
    again = replace(first, finer=4)
    assert (
        choice.next_attempt([first])
        == choice.next_attempt([first, again])
        == Trial(0, 1, "simultaneous")
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


def test_a_diagnosis_tells_where_it_sticks() -> None:
    box = snake((3, 3, 3))
    cluster = diagnose(box, at_rest(box), Parameters())
    assert cluster is not None and cluster.kind == "contacts"
    turns = np.abs(box.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    assert cluster.modules == tuple((np.flatnonzero(turns) + 1).tolist())
    assert "16 hinges were still bent, by up to 90°" in cluster.words
    assert diagnose(box, at_rest(box, status="straight"), Parameters()) is None
    assert diagnose(box, at_rest(box, status="cancelled"), Parameters()) is None
    zigzag = [(0, 0, 0)]
    for k in range(12):
        x, y, _ = zigzag[-1]
        zigzag += (
            [(x + 1, y, 0), (x + 1, y + 1, 0)] if k % 2 else [(x, y + 1, 0), (x + 1, y + 1, 0)]
        )
    stairs = Chain.from_path(Path.from_cells(list(dict.fromkeys(zigzag)), name="stairs"))
    free = diagnose(stairs, at_rest(stairs), Parameters())
    assert free is not None and free.kind == "joints" and free.modules
    record = at_rest(stairs)
    straight = record.frames.with_columns(joint_angles_rad=0.0 * stairs.folded_rad[None])
    late = diagnose(stairs, replace(record, frames=straight, status="timeout"), Parameters())
    assert late is not None and (late.kind, late.modules) == ("limit", ())
    half = record.frames.with_columns(joint_angles_rad=0.5 * stairs.folded_rad[None])
    for status, kind in (("stalled", "joints"), ("diverged", "broken"), ("timeout", "limit")):
        found = diagnose(stairs, replace(record, frames=half, status=status), Parameters())
        assert found is not None and found.kind == kind
        assert bool(found.modules) == (kind != "limit")
    json.dumps(late.as_dict())


def test_a_peeling_that_stops_says_what_is_buried() -> None:
    chain = snake((4, 4, 4))
    hasty = PeelingParameters(max_steps_per_module=0)
    record = peel(chain, replace(hasty, patience=10**6))
    assert record.status == "straight" or diagnose(chain, record, Parameters()) is not None
    calls = 0

    def soon() -> bool:
        nonlocal calls
        calls += 1
        return calls > 2

    broken = replace(peel(chain, PeelingParameters(), cancelled=soon), status="stalled")
    found = diagnose(chain, broken, Parameters())
    assert found.kind == "buried"
    assert found.modules and min(found.modules) > 10
    # A joint that stays bent by less is where it sticks, too.
    core = min(found.modules) - 2
    angles = broken.frames.dense(chain, -1).joint_angles_rad
    hardly = np.where(np.arange(angles.shape[1]) < 2 * core, chain.folded_rad, 0.5 * angles)
    one = at_rest(chain, strategy="peel")
    frames = one.frames.with_columns(joint_angles_rad=hardly)
    slight = diagnose(chain, replace(one, frames=frames), Parameters())
    assert slight is not None and slight.kind == "buried"
    assert slight.modules and min(slight.modules) > 10


@pytest.mark.slow
def test_all_that_was_tried_is_in_the_plan(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first strategy sticks, the second one brings the plan; who asked for one gets that."""

    def sticks(chain: Chain, *arguments: Any, **more: Any) -> Record:
        hasty = ExplosionParameters(max_steps=40)
        return replace(explode(chain, hasty, **more), status="stalled", reason="it sticks")

    monkeypatch.setattr("planner.explosion.strategies.explode", sticks)
    cells = [
        (x if y % 2 == 0 else 2 - x, y, z if z < 2 else z)
        for z in (0,)
        for y in range(3)
        for x in range(3)
    ]
    cells += [(2 - x if y % 2 == 0 else x, 2 - y, 1) for y in range(3) for x in range(3)]
    path = write_path(Path.from_cells(cells, name="slab"))
    (tmp_path / "auto").mkdir()
    Workspace(tmp_path / "auto").write_request(FoldRequest(), path)
    summary = run_stages(tmp_path / "auto")
    assert summary["status"] == "verified"
    plan = Plan.load(tmp_path / "auto" / "plan.npz")
    assert [(a["strategy"], a["status"]) for a in plan.attempts[-2:]] == [
        ("simultaneous", "stalled"),
        ("peel", "straight"),
    ]
    assert plan.attempts[0]["diagnosis"]["kind"] in ("contacts", "joints", "limit")
    assert plan.attempts[-1]["diagnosis"] is None
    (tmp_path / "one").mkdir()
    Workspace(tmp_path / "one").write_request(FoldRequest(strategy="simultaneous"), path)
    failed = run_stages(tmp_path / "one")
    assert failed["status"] == "failed" and "it sticks" in failed["reason"]
    tried = Plan.load(tmp_path / "one" / "plan.npz").attempts
    assert failed["stuck"] in [attempt["diagnosis"] for attempt in tried]
    assert summary["stuck"] is None
    assert {a["strategy"] for a in tried} == {"simultaneous"}
    assert len(Timeline.open(tmp_path / "one" / "timeline.zarr")) > 0
