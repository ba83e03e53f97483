from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.certificate.certificate import Certificate, Place, certify
from planner.chain.chain import Chain
from planner.errors import InputError, SimulationError
from planner.explosion.simultaneous import explode
from planner.motion.motion import PHASES
from planner.motion.record import Record
from planner.motion.timeline import Timeline, TimelineWriter
from planner.pipeline.fold_layout import result
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import next_stage, run_stage, run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_path
from planner.progress import STAGES, Progress
from planner.simulation.anchored import Anchored
from planner.simulation.engine import SpringChain
from planner.simulation.reduced import Acceleration, State
from planner.simulation.segments import Segments
from tests.planner.chains import COIL

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
OUTPUTS = {
    "read": ["candidates.json", "chain.json"],
    "explode": ["attempts.json", "record.npz"],
    "play_back": ["playback.npz"],
    "certify": ["certificate.json"],
    "export": ["model.xml", "plan.json", "plan.npz"],
}


def begun(directory: FilePath, **values: Any) -> FilePath:
    directory.mkdir(exist_ok=True)
    Workspace(directory).write_request(FoldRequest(**values), write_path(COIL))
    return directory


def run(directory: FilePath, *stages: str) -> list[dict[str, Any]]:
    results = [run_stage(stage, directory) for stage in stages]
    for told in results:
        json.dumps(told, allow_nan=False)
    return results


def timeless(value: Any) -> Any:
    """Without what a clock says."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k != "seconds"}
    return value


def test_all_stages_make_a_verified_plan(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = begun(tmp_path / "fold")
    create, made = TimelineWriter.create, list[Any]()
    monkeypatch.setattr(
        TimelineWriter, "create", lambda *args, **how: made.append(args) or create(*args, **how)
    )
    read, explode, play_back, certify, export = run(directory, *STAGES)
    assert len(made) == 1  # nobody waits for a timeline that is replaced at once
    assert (read["name"], read["modules"], read["joints"], read["hinges"]) == ("coil", 12, 10, 20)
    assert explode["status"] == "straight"
    assert play_back["status"] == "folded"
    assert certify["verdict"] == "verified (simulated)"
    assert export["status"] == "verified"
    assert export["reason"] == ""
    expected = {name for names in OUTPUTS.values() for name in names}
    present = {path.name for path in directory.iterdir()}
    others = {"request.json", "input", "timeline.zarr", "figures.zarr", "manifest.json"}
    assert present == expected | others
    assert Plan.load(directory / "plan.json").verified


def test_the_timeline_holds_explosion_then_playback(folded: Callable[..., Any]) -> None:
    fold = folded("wrench-24")
    timeline = Timeline.open(fold.directory / "timeline.zarr")
    frames = timeline.frames()
    assert timeline.status == "complete"
    explosion = int((frames.phase == PHASES.index("explosion")).sum())
    assert explosion == len(fold.record.frames)
    assert (np.diff(frames.phase.astype(int)) >= 0).all()
    assert (np.diff(frames.time_s) >= 0).all()
    np.testing.assert_array_equal(
        frames.joint_angles_rad[explosion:], fold.playback.frames.joint_angles_rad
    )
    assert np.isnan(frames.joint_error_rad[:explosion]).all()
    assert np.isfinite(frames.joint_error_rad[explosion:]).all()
    # The playback begins where the explosion has left the chain.
    np.testing.assert_allclose(
        frames.root_position[explosion], frames.root_position[explosion - 1], atol=1e-9
    )


@pytest.mark.parametrize(
    "again_from",
    [
        *("read", "certify"),
        *(pytest.param(s, marks=pytest.mark.long) for s in STAGES[1:3] + STAGES[4:]),
    ],
)
def test_any_stage_can_be_run_again(
    again_from: str, folded: Callable[..., Any], tmp_path: FilePath
) -> None:
    first = folded("wrench-24").directory
    directory = tmp_path / "again"
    shutil.copytree(first, directory)
    later = STAGES[STAGES.index(again_from) :]
    for stage in later:
        for name in OUTPUTS[stage]:
            (directory / name).unlink()
    run(directory, *later)
    before, after = Plan.load(first / "plan.npz"), Plan.load(directory / "plan.npz")
    assert timeless(before.summary()) == timeless(after.summary())
    np.testing.assert_array_equal(before.joint_angles_rad, after.joint_angles_rad)
    np.testing.assert_array_equal(before.root_position, after.root_position)
    mine, theirs = (Timeline.open(d / "timeline.zarr").frames() for d in (first, directory))
    np.testing.assert_array_equal(mine.joint_angles_rad, theirs.joint_angles_rad)
    np.testing.assert_array_equal(mine.phase, theirs.phase)
    np.testing.assert_array_equal(mine.time_s, theirs.time_s)


class Killed(BaseException):
    """The process ends here."""


@pytest.mark.parametrize(
    "stage",
    ["explode", *(pytest.param(s, marks=pytest.mark.long) for s in ("play_back", "certify"))],
)
def test_a_stage_killed_half_way_leaves_nothing_half_written(
    stage: str, folded: Callable[..., Any], tmp_path: FilePath
) -> None:
    whole = folded("wrench-24")
    directory = tmp_path / "killed"
    shutil.copytree(whole.directory, directory)
    shutil.rmtree(directory / "figures.zarr")
    for later in STAGES[STAGES.index(stage) :]:
        for name in OUTPUTS[later]:
            (directory / name).unlink()
    asked = 0

    def killed() -> bool:
        nonlocal asked
        asked += 1
        if asked == 4:
            raise Killed
        return False

    with pytest.raises(Killed):
        run_stage(stage, directory, cancelled=killed)
    left = {path.name for path in directory.iterdir()}
    earlier = [name for s in STAGES[: STAGES.index(stage)] for name in OUTPUTS[s]]
    under_way = {"attempts.json", "attempts"} if stage == "explode" else {"timeline.zarr"}
    assert left == {*earlier, *under_way, "request.json", "input"}
    Timeline.open(result(directory, "timeline.zarr")).frames()
    run(directory, *STAGES[STAGES.index(stage) :])
    again = Plan.load(directory / "plan.npz")
    np.testing.assert_array_equal(again.joint_angles_rad, whole.plan.joint_angles_rad)
    assert timeless(again.summary()) == timeless(whole.plan.summary())


def break_explosions(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    calls = 0

    def breaking(original: Any) -> Any:
        def broken(self: SpringChain, state: State, forces: Array, *more: Array) -> Acceleration:
            nonlocal calls
            calls += 1
            if calls > after:
                raise SimulationError("it blew up.")
            return original(self, state, forces, *more)

        return broken

    for kind, name in (
        (Segments, "accelerations"),
        (Segments, "free_accelerations"),
        (Anchored, "accelerations"),
    ):
        monkeypatch.setattr(kind, name, breaking(getattr(kind, name)))


@pytest.mark.parametrize("after", [pytest.param(0, marks=pytest.mark.long), 60])
def test_a_failed_explosion_still_gives_a_plan_that_says_so(
    after: int, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = begun(tmp_path / "fold")
    break_explosions(monkeypatch, after)
    _, explode, play_back, certify, export = run(directory, *STAGES)
    assert explode["status"] == "diverged"
    assert play_back["status"] == "skipped"
    assert certify["verdict"].startswith("failed: the explosion diverged")
    assert export["status"] == "failed"
    assert "it blew up" in export["reason"]
    plan = Plan.load(directory / "plan.json")
    assert not plan.verified
    assert len(plan.time_s) == 0
    assert plan.summary()["explosion"]["status"] == "diverged"
    timeline = Timeline.open(directory / "timeline.zarr")
    assert timeline.status == "failed"
    assert len(timeline) == len(Record.load(directory / "record.npz").frames)


def test_a_good_fold_leaves_nothing_to_a_bad_one_in_the_same_place(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = begun(tmp_path / "fold")
    assert run(directory, *STAGES)[-1]["status"] == "verified"
    (directory / "picture.png").write_bytes(b"of the shape before")
    break_explosions(monkeypatch, 60)
    Workspace(directory).write_request(FoldRequest(seed=1), write_path(COIL))
    export = run(directory, *STAGES)[-1]
    assert not (directory / "picture.png").exists()
    assert export["status"] == "failed"
    assert export["playback"] is None
    assert len(Plan.load(directory / "plan.npz").time_s) == 0


def test_direct_servoing_has_no_explosion(tmp_path: FilePath) -> None:
    directory = begun(tmp_path / "fold")
    run(directory, *STAGES)
    Workspace(directory).write_request(FoldRequest(preset="direct"), write_path(COIL))
    _, explode, play_back, certify, export = run(directory, *STAGES)
    assert explode["status"] == "none"
    assert play_back["steps"] > 0
    assert certify["min_clearance_record"] is None
    assert export["explosion"] == {"steps": 0, "frames": 0, "seconds": 0.0}
    timeline = Timeline.open(directory / "timeline.zarr")
    assert set(timeline.frames().phase.tolist()) == {PHASES.index("playback")}


@pytest.mark.parametrize("stage", ["explode", "play_back", "certify"])
def test_a_cancelled_stage_is_never_a_verified_plan(
    stage: str, folded: Callable[..., Any], tmp_path: FilePath
) -> None:
    directory = tmp_path / "cancelled"
    shutil.copytree(folded("wrench-24").directory, directory)
    place = STAGES.index(stage)
    result = run_stage(stage, directory, cancelled=lambda: True)
    if stage != "certify":
        assert result["status"] == "cancelled"
    run(directory, *STAGES[place + 1 :])
    plan = Plan.load(directory / "plan.npz")
    assert not plan.verified
    assert "cancelled" in plan.certificate.verdict


def test_progress_of_every_stage_ends_at_one(tmp_path: FilePath) -> None:
    directory = begun(tmp_path / "fold")
    for stage in STAGES:
        told: list[Progress] = []
        run_stage(stage, directory, progress=told.append)
        assert {p.stage for p in told} == {stage}
        assert told[-1].fraction == 1.0
        assert all(0.0 <= p.fraction <= 1.0 for p in told)


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"preset": "ours"}, "unknown-preset"),
        ({"seed": -1}, "bad-seed"),
        ({"seed": 2**63}, "bad-seed"),
        ({"module_size": 0.01}, "bad-module-size"),
        ({"module_size": 1.01}, "bad-module-size"),
        ({"module_size": float("nan")}, "bad-module-size"),
    ],
)
def test_a_request_out_of_range_is_refused(
    values: dict[str, Any], code: str, tmp_path: FilePath
) -> None:
    directory = begun(tmp_path / "fold", **values)
    with pytest.raises(InputError) as refused:
        run_stage("read", directory)
    assert refused.value.code == code
    assert not (directory / "chain.json").exists()


def test_a_chain_that_sticks_makes_room_for_the_next_candidate(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [[x, y, z] for x in range(4) for y in range(2) for z in range(2)]
    data = json.dumps({"format": "foldback-voxels/1", "name": "bar", "cells": cells}).encode()
    # One strategy, so that there is little else to change.
    Workspace(tmp_path).write_request(
        FoldRequest(filename="bar.json", strategy="simultaneous"), data
    )
    read = run_stage("read", tmp_path)
    assert read["kind"] == "voxels"
    assert read["candidates"] >= 2
    candidates = json.loads((tmp_path / "candidates.json").read_bytes())["chains"]

    def stuck_at_first(chain: Chain, *arguments: Any, **more: Any) -> Record:
        record = explode(chain, *arguments, **more)
        first = chain.folded_rad.tolist() == candidates[0]["folded_rad"]
        return replace(record, status="stalled", reason="it is stuck") if first else record

    monkeypatch.setattr("planner.explosion.strategies.explode", stuck_at_first)
    for stage in STAGES[1:]:
        summary = run_stage(stage, tmp_path)
    assert summary["status"] == "verified"
    plan = Plan.load(tmp_path / "plan.json")
    assert [attempt["status"] for attempt in plan.attempts] == ["stalled", "straight"]
    assert plan.chain.folded_rad.tolist() == candidates[1]["folded_rad"]
    # The timeline that people see is that of the candidate that came out.
    timeline = Timeline.open(tmp_path / "timeline.zarr")
    assert timeline.chain.folded_rad.tolist() == candidates[1]["folded_rad"]
    assert timeline.frames().joint_angles_rad[0].tolist() == candidates[1]["folded_rad"]


def test_bad_input_is_refused_and_nothing_is_written(tmp_path: FilePath) -> None:
    directory = begun(tmp_path / "fold")
    (directory / "input").write_bytes(b"[[0,0,0],[2,0,0],[3,0,0]]")
    with pytest.raises(InputError, match="cells 0 and 1"):
        run_stage("read", directory)
    assert not (directory / "chain.json").exists()


def refuse_first(monkeypatch: pytest.MonkeyPatch, times: int, *, frame: float) -> None:
    """Certificates that refuse the playback, for as long as they are asked from the start."""
    asked = 0

    def refused(*arguments: Any, **more: Any) -> Certificate:
        nonlocal asked
        asked += 1
        found = certify(*arguments, **more)
        if asked > times:
            return found
        return replace(
            found,
            verdict="failed: in the simulated playback, modules 1 and 9 overlap",
            min_clearance_playback=-0.001,
            min_clearance_playback_at=Place(frame=frame, modules=(1, 9)),
        )

    monkeypatch.setattr("planner.pipeline.certifying.certify", refused)


def test_an_overlap_between_frames_is_looked_at_with_more_of_them(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse_first(monkeypatch, 1, frame=3.5)
    directory = begun(tmp_path / "fold")
    assert run_stages(directory)["status"] == "verified"
    first, second = Plan.load(directory / "plan.json").attempts
    assert first["verdict"].startswith("failed")
    assert (second["verdict"], second["seed"], second["finer"]) == ("verified (simulated)", 0, 4)
    frames = len(Plan.load(directory / "plan.npz").time_s)
    monkeypatch.undo()
    usual = begun(tmp_path / "usual")
    run_stages(usual)
    assert frames > 2 * len(Plan.load(usual / "plan.npz").time_s)
    assert len(Timeline.open(directory / "timeline.zarr")) == frames + second["frames"]


def test_a_refused_plan_is_tried_with_the_next_seed(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse_first(monkeypatch, 1, frame=3.0)
    directory = begun(tmp_path / "fold", seed=7)
    assert run_stages(directory)["status"] == "verified"
    attempts = Plan.load(directory / "plan.json").attempts
    assert [attempt["seed"] for attempt in attempts] == [7, 8]
    assert [attempt["verdict"].startswith("verified") for attempt in attempts] == [False, True]
    record = Record.load(directory / "record.npz")
    anew = explode(Chain.from_path(COIL), FoldRequest().parameters().explosion, seed=8)
    np.testing.assert_array_equal(record.frames.joint_angles_rad, anew.frames.joint_angles_rad)


@pytest.mark.long
def test_a_plan_that_is_always_refused_ends_as_a_failure(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse_first(monkeypatch, 99, frame=2.5)
    directory = begun(tmp_path / "fold")
    assert run_stages(directory)["status"] == "failed"
    attempts = Plan.load(directory / "plan.json").attempts
    assert [(a["seed"], a.get("finer", 1)) for a in attempts] == [
        *((0, 1), (0, 4), (1, 1), (1, 4), (2, 1), (2, 4))
    ]


@pytest.mark.long
@pytest.mark.parametrize("at", [4, 5, 6])
def test_a_second_attempt_that_is_killed_comes_to_the_same(
    at: int, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each stage is run twice, as after a kill between its last file and the note of its end."""
    names = ["read", "explode", "play_back", "certify", "explode", "play_back", "certify", "export"]
    plans: list[Plan] = []
    for doubled in (None, at):
        refuse_first(monkeypatch, 1, frame=3.0)
        directory = begun(tmp_path / f"fold-{doubled}")
        for number, stage in enumerate(names):
            result = run_stage(stage, directory)
            if number == doubled:
                result = run_stage(stage, directory)
            assert next_stage(stage, result) == (names[number + 1 :] or [None])[0]
        plans.append(Plan.load(directory / "plan.npz"))
        monkeypatch.undo()
    np.testing.assert_array_equal(plans[0].joint_angles_rad, plans[1].joint_angles_rad)
    assert [timeless(a) for a in plans[0].attempts] == [timeless(a) for a in plans[1].attempts]


def test_what_was_published_is_not_tried_again(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse_first(monkeypatch, 9, frame=3.0)
    directory = begun(tmp_path / "fold", preset="direct")
    assert run_stages(directory)["status"] == "failed"
    assert Plan.load(directory / "plan.json").attempts == ()


def test_a_fold_that_was_read_before_there_were_other_ends_goes_on(tmp_path: FilePath) -> None:
    Workspace(tmp_path).write_request(FoldRequest(), write_path(COIL))
    run_stage("read", tmp_path)
    candidates = tmp_path / "candidates.json"
    chains = json.loads(candidates.read_bytes())["chains"]
    candidates.write_text(json.dumps(chains))
    assert run_stage("explode", tmp_path)["status"] == "straight"
