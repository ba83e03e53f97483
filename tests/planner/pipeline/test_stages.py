import json
import os
import shutil
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any
from unittest.mock import Mock, patch

import numpy as np
import pytest

from foldback.planner.certificate.certificate import Place
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import SimulationError
from foldback.planner.explosion.loop.whole_chain import WholeChain
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.pipeline.stages import next_stage, run_stage
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from foldback.planner.progress import STAGES, Progress
from foldback.planner.reasons import Reason, ReasonCode
from tests.planner.folds import compare_motions, falsify, intercept, untimed, write_request

pytestmark = pytest.mark.slow

OUTPUTS = {
    "read": ["candidates.json", "chain.json"],
    "explode": ["attempts.json", "record.npz"],
    "play_back": ["playback.npz"],
    "certify": ["certificate.json"],
    "export": ["model.xml", "plan.npz"],
}


def run(directory: FilePath, *stages: str) -> list[dict[str, Any]]:
    """Run stages one by one: the results must be JSON, and the progress reach the end."""
    results: list[dict[str, Any]] = []
    for stage in stages:
        reports: list[Progress] = []
        results.append(run_stage(stage, directory, progress=reports.append))
        json.dumps(results[-1], allow_nan=False)
        assert {p.stage for p in reports} == {stage}
        assert reports[-1].fraction == 1.0
        assert all(0.0 <= p.fraction <= 1.0 for p in reports)
    return results


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> tuple[FilePath, list[dict[str, Any]]]:
    """Directory of a fold that has passed all stages, for tests to copy, and their results."""
    directory = write_request(tmp_path_factory.mktemp("whole"))
    with patch.object(TimelineWriter, "create", side_effect=TimelineWriter.create) as create:
        results = run(directory, *STAGES)
    assert create.call_count == 1  # not replaced immediately
    return directory, results


@pytest.fixture
def copy(full: tuple[FilePath, Any], tmp_path: FilePath) -> FilePath:
    """Copy of a fold whose stages a test may run again."""
    return shutil.copytree(full[0], tmp_path / "copy")


def test_all_stages_make_a_verified_plan(full: tuple[FilePath, list[dict[str, Any]]]) -> None:
    directory, (read, explode, play_back, certify, export) = full
    assert (read["name"], read["modules"], read["joints"], read["hinges"]) == ("coil", 12, 10, 20)
    assert explode["status"] == "straight"
    assert play_back["status"] == "folded"
    assert certify["verified"] and certify["simulated"]
    assert (export["status"], export["reason"]) == ("verified", "")
    expected = {name for names in OUTPUTS.values() for name in names}
    other_files = {"request.json", "input", "timeline", "manifest.json"}
    assert {path.name for path in directory.iterdir()} == expected | other_files
    assert Plan.load(directory / "plan.npz").verified


class Killed(BaseException):
    """Error that stands for the end of the process."""


@pytest.mark.parametrize("stage", ["explode", "certify"])
def test_stage_killed_half_way_leaves_nothing_half_written_and_can_be_run_again(
    stage: str, full: tuple[FilePath, Any], copy: FilePath
) -> None:
    place = STAGES.index(stage)
    # Before the export, the file of the playback holds the reference.
    Playback.load(copy / "playback.npz").save(copy / "playback.npz", frames=False)
    for later in STAGES[place:]:
        for name in OUTPUTS[later]:
            (copy / name).unlink()
    with pytest.raises(Killed):
        run_stage(stage, copy, cancelled=Mock(side_effect=[False, False, False, Killed]))
    earlier = [name for s in STAGES[:place] for name in OUTPUTS[s]]
    under_way = {"attempts.json", "attempts"} if stage == "explode" else {"timeline"}
    files = {path.name for path in copy.iterdir()}
    assert files == {*earlier, *under_way, "request.json", "input"}
    Timeline.open(result_path(copy, "timeline")).frames()
    run(copy, *STAGES[place:])
    first, copied_plan = (Plan.load(d / "plan.npz") for d in (full[0], copy))
    compare_motions(copied_plan.motion, first.motion)
    assert untimed(copied_plan.summary()) == untimed(first.summary())
    compare_motions(*(Timeline.open(d / "timeline").frames() for d in (copy, full[0])))


def test_failed_explosion_in_the_directory_of_a_good_fold_gives_a_failed_plan(
    copy: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (copy / "picture.png").write_bytes(b"of the shape before")

    def broken(number: int, original: Any, *arguments: Any) -> Any:
        if number > 1:
            raise SimulationError("it blew up.")
        return original(*arguments)

    intercept(monkeypatch, WholeChain, "make_steps", broken)
    _, explode, play_back, certify, export = run(
        write_request(copy, strategy="simultaneous"), *STAGES
    )
    assert not (copy / "picture.png").exists()
    assert explode["status"] == "diverged"
    assert play_back["status"] == "skipped"
    assert certify["reason"]["code"] == "simulation-failed"
    assert (export["status"], export["playback"]) == ("failed", None)
    assert "it blew up" in export["reason"]
    plan = Plan.load(copy / "plan.npz")
    assert not plan.verified
    assert len(plan.time_s) == 0
    assert plan.summary()["explosion"]["status"] == "diverged"
    timeline = Timeline.open(copy / "timeline")
    assert timeline.status == "failed"
    with np.load(copy / "record.npz") as record:  # which others check without the timeline
        assert len(record["time_s"]) == len(timeline)


def test_power_cut_during_export_leaves_the_reference(
    copy: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plan must be on the disk before the file of the playback drops the plan's angles."""
    Playback.load(copy / "playback.npz").save(copy / "playback.npz", frames=False)
    (copy / "plan.npz").unlink()
    flushed: list[int] = []
    flush, rename = os.fsync, FilePath.replace

    def fsync(handle: int) -> None:
        flushed.append(os.fstat(handle).st_ino)
        flush(handle)

    def replace(path: FilePath, target: FilePath) -> FilePath:
        if target.name == "playback.npz":
            assert (copy / "plan.npz").stat().st_ino in flushed
            assert path.stat().st_ino in flushed
        return rename(path, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(FilePath, "replace", replace)
    run(copy, "export")
    assert (copy / "playback.npz").stat().st_ino in flushed


@pytest.mark.parametrize("stage", ["explode", "play_back", "certify"])
def test_cancelled_stage_gives_a_failed_plan(stage: str, copy: FilePath) -> None:
    result = run_stage(stage, copy, cancelled=lambda: True)
    if stage != "certify":
        assert result["status"] == "cancelled"
    run(copy, *STAGES[STAGES.index(stage) + 1 :])
    plan = Plan.load(copy / "plan.npz")
    assert not plan.verified
    assert "cancelled" in plan.certificate.verdict


def test_next_candidate_is_tried_when_a_chain_sticks(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [[x, y, z] for x in range(4) for y in range(2) for z in range(2)]
    data = json.dumps({"format": "foldback-voxels/1", "name": "bar", "cells": cells}).encode()
    # One strategy only, so that little else may vary.
    write_request(tmp_path, data, filename="bar.json", strategy="simultaneous")
    read = run_stage("read", tmp_path)
    assert read["kind"] == "voxels"
    assert read["candidates"] >= 2
    candidates = json.loads((tmp_path / "candidates.json").read_bytes())["chains"]

    def stuck_at_first(chain: Chain, *arguments: Any, **extra: Any) -> Record:
        record = explode(chain, *arguments, **extra)
        first = chain.folded_rad.tolist() == candidates[0]["folded_rad"]
        return (
            replace(record, status="stalled", reason=Reason.of(ReasonCode.AT_REST, steps=1))
            if first
            else record
        )

    monkeypatch.setattr("foldback.planner.explosion.strategies.explode", stuck_at_first)
    for stage in STAGES[1:]:
        summary = run_stage(stage, tmp_path)
    assert summary["status"] == "verified"
    plan = Plan.load(tmp_path / "plan.npz")
    assert [attempt["status"] for attempt in plan.attempts] == ["stalled", "straight"]
    assert plan.chain.folded_rad.tolist() == candidates[1]["folded_rad"]
    # The public timeline is that of the candidate that was verified.
    timeline = Timeline.open(tmp_path / "timeline")
    assert timeline.chain.folded_rad.tolist() == candidates[1]["folded_rad"]
    assert timeline.frames().joint_angles_rad[0].tolist() == candidates[1]["folded_rad"]


def test_overlap_between_frames_is_played_back_again_with_finer_frames(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    falsify(
        monkeypatch,
        times=1,
        reason=Reason.of(ReasonCode.PLAN_END),
        min_clearance_playback=-0.001,
        min_clearance_playback_at=Place(frame=3.5, modules=(1, 9)),
    )
    directory = write_request(tmp_path)
    run(directory, "read", "explode", "play_back")
    coarse = len(Playback.load(result_path(directory, "playback.npz")).frames)
    stage: str | None = "certify"
    while stage is not None:
        stage = next_stage(stage, run_stage(stage, directory))
    plan = Plan.load(directory / "plan.npz")
    first, second = plan.attempts
    assert first["verified"] is False and first["refusal"]["code"] == "plan-end"
    assert (second["verified"], second["seed"], second["finer"]) == (True, 0, 4)
    assert len(plan.motion) > 2 * coarse
    assert len(Timeline.open(directory / "timeline")) == len(plan.motion) + second["frames"]
