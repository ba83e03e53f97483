"""Plans that are made from verified ones: shorter, quieter, certified anew."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.certificate.certificate import Certificate, Place, certify
from planner.clearance.sweep import sweep
from planner.errors import InputError
from planner.motion.record import Record
from planner.motion.timeline import Timeline
from planner.pipeline import stages
from planner.pipeline.fold import refold, smooth_plan
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain
from planner.playback.playback import Playback
from planner.robot import RECORDED, SMOOTHED, SOFTENED
from planner.robot.smoothed import check_smoothable, smoothed_record
from planner.verification.verify import verify
from tests.planner.conftest import Folded
from tests.planner.plans import changed

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def mallet(folded: Callable[..., Folded]) -> Folded:
    return folded("mallet-64")


@pytest.fixture(scope="module")
def made(mallet: Folded, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The directory of a smoothed mallet. Look, don't touch."""
    directory = tmp_path_factory.mktemp("smoothed")
    smooth_plan(mallet.plan, directory=directory)
    return directory


@pytest.fixture(scope="module")
def plan(made: FilePath) -> Plan:
    return Plan.load(made / "plan.npz")


def test_a_smoothed_plan_is_verified_and_better(plan: Plan, mallet: Folded) -> None:
    assert plan.verified
    before, after = plan.smoothing["before"], plan.smoothing["after"]
    assert plan.smoothing["way"] == SMOOTHED
    assert plan.smoothing["seconds"] == mallet.plan.certificate.fold_time_s
    for name, most in (
        ("frames", 0.9),
        ("fold_time_s", 0.8),
        ("length_rad", 0.8),
        ("peak_speed_rad_s", 0.8),
        ("peak_torque_nm", 1.0),
    ):
        assert after[name] <= most * before[name], name
    assert after["hinges_moving_mean"] > 0.95 * before["hinges_moving_mean"]
    assert after["clearance"] > 0.01
    assert after["frames"] == len(plan.time_s)
    assert before["frames"] == len(mallet.plan.time_s)


def test_it_leads_from_straight_to_the_same_shape(plan: Plan, mallet: Folded) -> None:
    assert np.abs(plan.joint_angles_rad[0]).max() < 1e-9
    np.testing.assert_allclose(plan.joint_angles_rad[-1], mallet.chain.folded_rad, atol=1e-9)
    assert plan.start is None


def test_its_files_are_checked_anew_and_its_timeline_only_folds(made: FilePath) -> None:
    assert verify(made).verified
    timeline = Timeline.open(made / "timeline.zarr").motion()
    assert not timeline.is_windowed
    assert len(timeline) == len(Plan.load(made / "plan.json").time_s)
    assert (timeline.phase == 1).all()


def test_what_has_changed_is_in_both_files_and_the_summary(made: FilePath, plan: Plan) -> None:
    assert Plan.load(made / "plan.json").smoothing == plan.smoothing
    assert plan.summary()["smoothing"] == plan.smoothing
    assert json.loads((made / "plan.json").read_bytes())["smoothing"]["before"]["frames"] > 0


def test_a_recorded_plan_says_nothing_of_it(mallet: Folded) -> None:
    assert mallet.plan.smoothing is None
    assert mallet.plan.summary()["smoothing"] is None


@pytest.mark.long
def test_the_same_seed_gives_the_same_plan(
    folded: Callable[..., Folded], tmp_path: FilePath
) -> None:
    wrench = folded("wrench-24").plan
    first, again = smooth_plan(wrench, seed=3), smooth_plan(wrench, seed=3, directory=tmp_path)
    np.testing.assert_array_equal(first.joint_angles_rad, again.joint_angles_rad)
    # A smoothed plan may be smoothed, and begun from.
    further = smooth_plan(first)
    assert further.smoothing["before"]["frames"] == len(first.time_s)


@pytest.mark.long
def test_what_the_certificate_refuses_is_smoothed_less(
    folded: Callable[..., Folded], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What would not do is stood in for by a motion on whose way the chain is curled up."""
    wrench = folded("wrench-24").plan
    real, tried = smoothed_record, list[str]()

    def spoiled(plan: Plan, way: str, **how: Any) -> Record:
        tried.append(way)
        record = real(plan, way, **how)
        if way == RECORDED:
            return record
        assert not record.frames.is_windowed
        angles = record.frames.joint_angles_rad.copy()
        angles[len(angles) // 2] = plan.chain.module.angle_limit_rad
        return replace(record, frames=record.frames.with_columns(joint_angles_rad=angles))

    monkeypatch.setattr("planner.pipeline.exploding.smoothed_record", spoiled)
    plan = smooth_plan(wrench, directory=tmp_path)
    assert tried == [SMOOTHED, SOFTENED, RECORDED]
    assert plan.verified
    assert plan.smoothing["way"] == RECORDED
    assert [a["verdict"].partition(":")[0] for a in plan.attempts] == [
        "failed",
        "failed",
        "verified (simulated)",
    ]


@pytest.mark.long
def test_overlaps_between_frames_leave_the_last_way_to_be_tried(
    folded: Callable[..., Folded], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judge(*arguments: Any, **more: Any) -> Certificate:
        found = certify(*arguments, **more)
        if json.loads((tmp_path / "attempts.json").read_text())[-1]["strategy"] == RECORDED:
            return found
        place = Place(frame=3.5, modules=(1, 9))
        return replace(
            found,
            verdict="failed: in the simulated playback, modules 1 and 9 overlap",
            min_clearance_playback=-0.001,
            min_clearance_playback_at=place,
        )

    monkeypatch.setattr("planner.pipeline.certifying.certify", judge)
    plan = smooth_plan(folded("wrench-24").plan, directory=tmp_path)
    assert plan.verified
    assert [(a["strategy"], a.get("finer", 1)) for a in plan.attempts] == [
        *((SMOOTHED, 1), (SMOOTHED, 4), (SOFTENED, 1), (SOFTENED, 4), (RECORDED, 1))
    ]


def test_clearances_before_and_after_are_at_one_module_size(
    folded: Callable[..., Folded],
) -> None:
    wrench = folded("wrench-24").plan
    size = 0.99
    plan = smooth_plan(wrench, module_size=size)
    before = plan.smoothing["before"]["clearance"]
    assert before < wrench.certificate.min_clearance
    swept = sweep(wrench.chain, wrench.joint_angles_rad, size=size).clearance
    assert before == pytest.approx(swept, abs=1e-9)


def test_an_interrupted_smoothing_comes_to_the_same(
    made: FilePath, plan: Plan, tmp_path: FilePath
) -> None:
    shutil.copytree(made, tmp_path / "again")
    result = stages.run_stage("play_back", tmp_path / "again")
    assert result["status"] == "folded"
    again = Playback.load(tmp_path / "again" / "playback.npz")
    np.testing.assert_array_equal(again.reference.joint_angles_rad, plan.joint_angles_rad)


def test_a_cancelled_smoothing_is_no_plan(mallet: Folded, tmp_path: FilePath) -> None:
    request = FoldRequest.smoothing(mallet.plan, seed=0, module_size=None)
    data = write_chain(mallet.plan.chain)
    Workspace(tmp_path).write_request(request, data, recorded=mallet.plan)
    summary = run_stages(tmp_path, cancelled=lambda: True)
    assert summary["status"] == "failed"
    assert summary["smoothing"]["after"] is None


def refused(plan: Plan) -> str:
    with pytest.raises(InputError) as told:
        check_smoothable(plan)
    return told.value.code


def test_what_cannot_be_smoothed_is_refused_in_words(
    folded: Callable[..., Folded], monkeypatch: pytest.MonkeyPatch
) -> None:
    wrench = folded("wrench-24").plan
    certificate = replace(wrench.certificate, verdict="failed: it overlaps")
    assert refused(changed(wrench, certificate=certificate)) == "smooth-not-verified"
    still = replace(wrench.certificate, fold_time_s=0.0)
    assert refused(changed(wrench, certificate=still)) == "smooth-no-motion"
    older = replace(wrench.certificate, peak_torque_nm=None)
    assert refused(changed(wrench, certificate=older)) == "smooth-no-torques"
    assert refused(refold(wrench, folded("mallet-24").chain)) == "smooth-refold"
    monkeypatch.setattr("planner.robot.smoothed.MAX_SMOOTHED_ANGLES", 1000)
    assert refused(wrench) == "smooth-too-long"


@pytest.mark.parametrize("wish", [{"preset": "paper"}, {"strategy": "peel"}])
def test_it_is_not_recorded_again(wish: dict[str, str]) -> None:
    with pytest.raises(InputError, match="smoothing runs no new explosion") as told:
        FoldRequest(smooth=True, **wish).check()  # pyright: ignore[reportArgumentType]
    assert told.value.where == next(iter(wish))
