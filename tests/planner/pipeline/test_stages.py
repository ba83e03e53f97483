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

from planner.certificate.certificate import Place
from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.explosion.simultaneous import explode
from planner.motion.motion import PHASES
from planner.motion.record import Record
from planner.motion.timeline import Timeline, TimelineWriter
from planner.pipeline.fold_layout import result
from planner.pipeline.stages import next_stage, run_stage
from planner.plan.plan import Plan
from planner.playback.playback import Playback
from planner.progress import STAGES, Progress
from planner.simulation.anchored import Anchored
from planner.simulation.engine import SpringChain
from planner.simulation.reduced import Acceleration, State
from planner.simulation.segments import Segments
from tests.planner.folds import asked, made, refuse, same_motion, timeless

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
OUTPUTS = {
    "read": ["candidates.json", "chain.json"],
    "explode": ["attempts.json", "record.npz"],
    "play_back": ["playback.npz"],
    "certify": ["certificate.json"],
    "export": ["model.xml", "moments.json", "plan.json", "plan.npz"],
}


def run(directory: FilePath, *stages: str) -> list[dict[str, Any]]:
    """Run stages one by one: each tells what JSON can hold, and reports progress up to its end."""
    results: list[dict[str, Any]] = []
    for stage in stages:
        told: list[Progress] = []
        results.append(run_stage(stage, directory, progress=told.append))
        json.dumps(results[-1], allow_nan=False)
        assert {p.stage for p in told} == {stage}
        assert told[-1].fraction == 1.0
        assert all(0.0 <= p.fraction <= 1.0 for p in told)
    return results


def test_all_stages_make_a_verified_plan(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    create, created = TimelineWriter.create, list[Any]()
    monkeypatch.setattr(
        TimelineWriter, "create", lambda *args, **how: created.append(args) or create(*args, **how)
    )
    read, explode, play_back, certify, export = run(asked(tmp_path), *STAGES)
    assert len(created) == 1  # nobody waits for a timeline that is replaced at once
    assert (read["name"], read["modules"], read["joints"], read["hinges"]) == ("coil", 12, 10, 20)
    assert explode["status"] == "straight"
    assert play_back["status"] == "folded"
    assert certify["verdict"] == "verified (simulated)"
    assert (export["status"], export["reason"]) == ("verified", "")
    expected = {name for names in OUTPUTS.values() for name in names}
    others = {"request.json", "input", "timeline.zarr", "figures.zarr", "manifest.json"}
    assert {path.name for path in tmp_path.iterdir()} == expected | others
    assert Plan.load(tmp_path / "plan.json").verified


def test_timeline_holds_explosion_then_playback(folded: Callable[..., Any]) -> None:
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


class Killed(BaseException):
    """The process ends here."""


@pytest.mark.parametrize(
    "stage",
    ["explode", *(pytest.param(s, marks=pytest.mark.long) for s in ("play_back", "certify"))],
)
def test_stage_killed_half_way_leaves_nothing_half_written_and_can_be_run_again(
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
    same_motion(again.motion, whole.plan.motion)
    assert timeless(again.summary()) == timeless(whole.plan.summary())
    same_motion(
        *(Timeline.open(d / "timeline.zarr").frames() for d in (directory, whole.directory))
    )


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


def test_failed_explosion_in_the_directory_of_a_good_fold_gives_a_failed_plan(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert made(tmp_path).verified
    (tmp_path / "picture.png").write_bytes(b"of the shape before")
    break_explosions(monkeypatch, 60)
    _, explode, play_back, certify, export = run(asked(tmp_path, seed=1), *STAGES)
    assert not (tmp_path / "picture.png").exists()
    assert explode["status"] == "diverged"
    assert play_back["status"] == "skipped"
    assert certify["verdict"].startswith("failed: the explosion diverged")
    assert (export["status"], export["playback"]) == ("failed", None)
    assert "it blew up" in export["reason"]
    plan = Plan.load(tmp_path / "plan.json")
    assert not plan.verified
    assert len(plan.time_s) == 0
    assert plan.summary()["explosion"]["status"] == "diverged"
    timeline = Timeline.open(tmp_path / "timeline.zarr")
    assert timeline.status == "failed"
    assert len(timeline) == len(Record.load(tmp_path / "record.npz").frames)


def test_direct_servoing_has_no_explosion(tmp_path: FilePath) -> None:
    _, explode, play_back, certify, export = run(asked(tmp_path, preset="direct"), *STAGES)
    assert explode["status"] == "none"
    assert play_back["steps"] > 0
    assert certify["min_clearance_record"] is None
    assert export["explosion"] == {"steps": 0, "frames": 0, "seconds": 0.0}
    timeline = Timeline.open(tmp_path / "timeline.zarr")
    assert set(timeline.frames().phase.tolist()) == {PHASES.index("playback")}


@pytest.mark.parametrize("stage", ["explode", "play_back", "certify"])
def test_cancelled_stage_gives_a_failed_plan(
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


def test_next_candidate_is_tried_when_a_chain_sticks(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [[x, y, z] for x in range(4) for y in range(2) for z in range(2)]
    data = json.dumps({"format": "foldback-voxels/1", "name": "bar", "cells": cells}).encode()
    # One strategy, so that there is little else to change.
    asked(tmp_path, data, filename="bar.json", strategy="simultaneous")
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


def test_overlap_between_frames_is_played_back_again_with_finer_frames(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse(
        monkeypatch,
        times=1,
        verdict="failed: in the simulated playback, modules 1 and 9 overlap",
        min_clearance_playback=-0.001,
        min_clearance_playback_at=Place(frame=3.5, modules=(1, 9)),
    )
    directory = asked(tmp_path)
    run(directory, "read", "explode", "play_back")
    coarse = len(Playback.load(result(directory, "playback.npz")).frames)
    stage: str | None = "certify"
    while stage is not None:
        stage = next_stage(stage, run_stage(stage, directory))
    plan = Plan.load(directory / "plan.npz")
    first, second = plan.attempts
    assert first["verdict"].startswith("failed")
    assert (second["verdict"], second["seed"], second["finer"]) == ("verified (simulated)", 0, 4)
    assert len(plan.motion) > 2 * coarse
    assert len(Timeline.open(directory / "timeline.zarr")) == len(plan.motion) + second["frames"]


def test_candidates_file_of_an_earlier_version_is_read(tmp_path: FilePath) -> None:
    run_stage("read", asked(tmp_path))
    candidates = tmp_path / "candidates.json"
    chains = json.loads(candidates.read_bytes())["chains"]
    candidates.write_text(json.dumps(chains))
    assert run_stage("explode", tmp_path)["status"] == "straight"
