"""Workspace: the best of several refused plans is shown, even if later attempts are interrupted."""

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.certificate.certificate import Certificate, Place
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.explosion import strategies
from foldback.planner.motion.motion import Phase
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.pipeline import certifying, workspace
from foldback.planner.pipeline.attempt import Attempt, AttemptSpec
from foldback.planner.pipeline.fold_layout import attempt_numbers, latest_attempt_dir, result_path
from foldback.planner.pipeline.stages import next_stage, run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.storage.file_names import (
    CERTIFICATE,
    PLANS_DIR,
    PLAYABLE,
    RESULT_FILES,
    TIMELINE,
)
from foldback.planner.storage.files import write_json
from tests.case import case
from tests.planner.chains import COIL, SQUARE, anchored
from tests.planner.folds import intercept, write_request
from tests.planner.peels import snake

pytestmark = pytest.mark.slow


OVERLAP = Reason.of(
    ReasonCode.OVERLAP,
    motion="plan",
    modules=[1, 9],
    depth=0.001,
    module_size=0.95,
    progress=0.5,
    frame=3.0,
)


def refuse_first_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make certificates refuse the first plan and accept later ones."""
    plans: list[bytes] = []
    overlap = {"reason": OVERLAP, "min_clearance": -0.001}
    overlap["min_clearance_at"] = Place(frame=3.0, modules=(1, 9))

    def judge(_: int, original: Any, *arguments: Any, **judge_options: Any) -> Certificate:
        playback = arguments[2]
        plans.append(b"" if playback is None else playback.frames.joint_angles_rad.tobytes())
        certificate = original(*arguments, **judge_options)
        return replace(certificate, **overlap) if plans[-1] == plans[0] else certificate

    intercept(monkeypatch, certifying, "certify", judge)


def stall_after_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make all explosions but the first one stall."""

    def explode_once(
        number: int, explode: Any, chain: Any, parameters: Any, **explode_options: Any
    ) -> Record:
        if number == 1:
            return explode(chain, parameters, **explode_options)
        hasty = ExplosionParameters(max_steps=40)
        return replace(
            explode(chain, hasty, **explode_options),
            status="stalled",
            reason=Reason.of(ReasonCode.AT_REST, steps=1),
        )

    intercept(monkeypatch, strategies, "explode", explode_once)


def test_refused_plan_is_shown_though_later_attempts_stick_and_stages_run_twice(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage runs twice if the process is killed after its last file, before its end is noted."""
    refuse_first_plan(monkeypatch)
    stall_after_first(monkeypatch)
    directory = write_request(tmp_path, write_path(SQUARE), strategy="simultaneous")
    stage: str | None = "read"
    number, result = 0, {}
    while stage is not None:
        result = run_stage(stage, directory)
        if number in (4, 6):
            result = run_stage(stage, directory)
        stage = next_stage(stage, result)
        number += 1
    assert number == 8
    assert (result["status"], result["stuck"]) == ("failed", None)
    assert "overlap" in result["reason"]
    assert result["certificate"]["min_clearance"] == -0.001
    plan = Plan.load(directory / "plan.npz")
    assert len(plan.time_s) > 10
    assert [a["status"] for a in plan.attempts][:2] == ["straight", "stalled"]
    frames = result["explosion"]["frames"] + len(plan.time_s)
    assert len(Timeline.open(directory / "timeline")) == frames
    assert not (directory / "attempts").exists()


def write_attempts(
    directory: FilePath, clearances: Sequence[float | None], *verified: bool
) -> None:
    """Write straight attempts; those with a clearance have a certificate."""
    workspace = Workspace(directory)
    tried_attempts = [
        Attempt(spec=AttemptSpec(0, k, "peel"), status="straight") for k in range(len(clearances))
    ]
    directory.mkdir(exist_ok=True)
    workspace.write_history(tried_attempts)
    for number, clearance in enumerate(clearances):
        chain = Chain.from_path(COIL)
        place = workspace.begin(number, chain).directory
        for name in RESULT_FILES:
            if name == TIMELINE:
                TimelineWriter.create(place / name, chain).close("failed")
            elif name != CERTIFICATE:
                (place / name).write_text(str(number))
        if clearance is not None:
            certificate = {
                "verified": bool(verified) and verified[number],
                "number": number,
                "min_clearance": clearance,
            }
            write_json(place / CERTIFICATE, {**certificate, "min_clearance_playback": 0.0})


def test_keep_best_keeps_the_attempt_with_most_progress(tmp_path: FilePath) -> None:
    for clearances, verified, best in (
        ((-0.3, -0.1, -0.2), (), 1),
        ((-0.3, None, None), (), 0),
        ((None, None), (), 1),
        ((-0.1, -0.1), (), 1),
        ((0.4, 0.1), (False, True), 1),
    ):
        with case((clearances, verified)):
            place = tmp_path / str(clearances)
            write_attempts(place, clearances, *verified)
            Workspace(place).keep_best()
            assert attempt_numbers(place) == [best]
            assert latest_attempt_dir(place) == place / "attempts" / str(best)


def test_keep_best_with_a_preference_stores_the_other_verified_plans(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    verified = (True, True, False, True)
    write_attempts(tmp_path, (0.1, 0.2, -0.1, 0.3), *verified)
    Workspace(tmp_path).keep_best("time")
    assert attempt_numbers(tmp_path) == [0]
    stored = {path.name: path for path in (tmp_path / PLANS_DIR).iterdir()}
    assert set(stored) == {"1", "3"}
    assert {path.name for path in stored["3"].iterdir()} == set(PLAYABLE)
    Workspace(tmp_path).clear()
    assert not (tmp_path / PLANS_DIR).exists()

    monkeypatch.setattr("foldback.planner.pipeline.workspace.MAX_PLANS_BYTES", 0)
    write_attempts(tmp_path, (0.1, 0.2), True, True)
    Workspace(tmp_path).keep_best("time")
    assert (attempt_numbers(tmp_path), (tmp_path / PLANS_DIR).exists()) == ([0], False)


def test_explosions_that_are_judged_stay(tmp_path: FilePath) -> None:
    write_attempts(tmp_path, (-0.3, -0.1, None, None))
    Workspace(tmp_path).keep_explosions([3])
    assert attempt_numbers(tmp_path) == [0, 1, 3]
    Workspace(tmp_path).begin(1, Chain.from_path(COIL))
    assert attempt_numbers(tmp_path) == [0, 1]
    fresh = {path.name for path in (tmp_path / "attempts" / "1").iterdir()}
    assert fresh == {"chain.json"}


def test_result_is_read_from_the_latest_attempt(tmp_path: FilePath) -> None:
    (tmp_path / "chain.json").write_text("of the first candidate")
    assert result_path(tmp_path, "chain.json").read_text() == "of the first candidate"
    write_attempts(tmp_path, (None, None))
    assert result_path(tmp_path, "chain.json").read_text() == "1"
    Workspace(tmp_path).begin(2, Chain.from_path(COIL))
    assert Workspace(tmp_path).read_chain().name == "coil"
    assert not result_path(tmp_path, "record.npz").exists()


@pytest.mark.parametrize("call", range(9))
def test_publishing_continues_after_an_interruption(
    call: int, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each change of a directory is interrupted once; results can be read throughout."""
    numbers = count()

    def interrupt(_: int, original: Any, *arguments: Any, **call_options: Any) -> Any:
        if next(numbers) == call:
            raise KeyboardInterrupt
        return original(*arguments, **call_options)

    write_attempts(tmp_path, (-0.2, -0.1, -0.3))
    (tmp_path / "chain.json").write_text("of the first candidate")
    with monkeypatch.context() as patched:
        for owner, name in ((FilePath, "rename"), (FilePath, "replace"), (workspace, "rmtree")):
            intercept(patched, owner, name, interrupt)
        try:
            Workspace(tmp_path).publish()
        except KeyboardInterrupt:
            assert result_path(tmp_path, "playback.npz").read_text() in ("1", "2")
            Workspace(tmp_path).publish()
    assert next(numbers) > 9
    for name in ("chain.json", "record.npz", "playback.npz"):
        assert (tmp_path / name).read_text() == "1"
    assert json.loads((tmp_path / CERTIFICATE).read_text())["number"] == 1
    assert {path.name for path in tmp_path.iterdir()} == {*RESULT_FILES, "attempts.json"}
    Workspace(tmp_path).publish()
    assert (tmp_path / "playback.npz").read_text() == "1"


CHAIN = snake((2, 2, 3))
OTHER = snake((3, 2, 2))


def write_record(path: FilePath, chain: Chain, share: float, phase: Phase = "explosion") -> None:
    """Write a timeline from the folded chain to a fraction of its bends."""
    angles = np.linspace(1.0, share, 4)[:, None] * chain.folded_rad
    with TimelineWriter.create(path, chain) as writer:
        writer.append(anchored(phase, angles))


def add_stopped_attempt(directory: FilePath, chain: Chain, share: float) -> None:
    """Add an attempt that stopped with this fraction of its bends remaining."""
    workspace = Workspace(directory)
    known_attempts = workspace.read_history()
    started = Attempt(spec=AttemptSpec(len(known_attempts), 0, "peel"), status="begun")
    workspace.write_history([*known_attempts, started])
    write_record(workspace.begin(len(known_attempts), chain).timeline, chain, share)


def modules_at_bends(chain: Chain) -> list[int]:
    """Return the numbers of the modules between bent joints."""
    bends = np.abs(chain.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    return (np.flatnonzero(bends) + 1).tolist()


def test_unfinished_fold_names_the_modules_that_are_not_in_place(tmp_path: FilePath) -> None:
    for phase, share, named in (
        ("explosion", 0.3, True),  # slight bends count if there are no others
        ("explosion", 1e-3, False),
        ("playback", 0.0, True),
        ("unfolding", 1.0, True),  # bends of the first shape have to become straight first, too
    ):
        with case((phase, share)):
            place = tmp_path / f"{phase}-{share}"
            write_record(place / "timeline", CHAIN, share, phase)
            stuck = Workspace(place).settle()["stuck"]
            assert stuck["modules"] == (modules_at_bends(CHAIN) if named else [])
            assert stuck["kind"] == "stopped"
            assert phase != "explosion" or "still unfolding" in stuck["words"]


def test_stopped_where_changes_no_file(tmp_path: FilePath) -> None:
    add_stopped_attempt(tmp_path, CHAIN, 0.3)
    add_stopped_attempt(tmp_path, OTHER, 0.8)
    before = sorted(tmp_path.rglob("*"))
    assert Workspace(tmp_path).stopped_where()["stuck"]["modules"] == modules_at_bends(OTHER)
    assert sorted(tmp_path.rglob("*")) == before
    assert Workspace(tmp_path / "nothing").stopped_where() == {}
    assert Workspace(tmp_path / "nothing").settle() == {}
    TimelineWriter.create(tmp_path / "empty" / "timeline", CHAIN).close("failed")
    assert Workspace(tmp_path / "empty").settle() == {}


@pytest.mark.parametrize(("left_share", "kept_chain"), [(0.3, OTHER), (0.9, CHAIN)])
def test_settle_keeps_the_explosion_with_most_progress(
    left_share: float, kept_chain: Chain, tmp_path: FilePath
) -> None:
    add_stopped_attempt(tmp_path, OTHER, left_share)
    add_stopped_attempt(tmp_path, CHAIN, 0.6)
    Workspace(tmp_path).settle()
    timeline = Timeline.open(tmp_path / "timeline")
    np.testing.assert_array_equal(timeline.chain.folded_rad, kept_chain.folded_rad)
    stored = chain_from_attributes(json.loads((tmp_path / "chain.json").read_text()))
    np.testing.assert_array_equal(stored.folded_rad, kept_chain.folded_rad)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("attempts.json", "chain.json", "timeline")
    }


def test_settle_shows_a_refused_plan_instead_of_a_later_explosion(tmp_path: FilePath) -> None:
    write_attempts(tmp_path, (-0.3, None))
    frames = anchored("explosion", CHAIN.folded_rad[None])
    record = Record(status="straight", reason=None, frames=frames, steps=1, seconds=0.1)
    record.save(tmp_path / "attempts" / "0" / "record.npz")
    summary = Workspace(tmp_path).settle()
    assert summary["certificate"]["min_clearance"] == -0.3
    assert summary["explosion"]["status"] == "straight"
    assert not (tmp_path / "attempts").exists()


def test_history_names_the_attempt_under_way(tmp_path: FilePath) -> None:
    run_stage("read", write_request(tmp_path, write_path(SQUARE)))
    seen_values: list[object] = []

    def note_attempts() -> bool:
        seen_values.append(json.loads((tmp_path / "attempts.json").read_text()))
        return False

    run_stage("explode", tmp_path, cancelled=note_attempts)
    started = Attempt(spec=AttemptSpec(0, 0, "turns", roomy=True), status="begun")
    assert seen_values[0] == [started.as_dict()]
    (after,) = Workspace(tmp_path).read_history()
    assert after.status == "straight"
    # An attempt that is interrupted there starts anew.
    Workspace(tmp_path).write_history([started])
    assert run_stage("explode", tmp_path)["attempts"] == 1
