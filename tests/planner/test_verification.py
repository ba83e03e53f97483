from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.errors import InputError, TimelineError
from planner.plan import Plan
from planner.replay import replay
from planner.verification import verify
from tests.planner.plans import changed

ROLLED_UP = np.tile([np.pi / 2, 0.0], 22)
"""All modules of a chain of 24 in four cells."""


@pytest.fixture
def directory(folded: Callable[..., Any], tmp_path: FilePath) -> FilePath:
    """A copy of a verified fold, to tamper with."""
    shutil.copytree(folded("wrench-24").directory, tmp_path / "fold")
    return tmp_path / "fold"


def rewrite(directory: FilePath, **changes: Any) -> None:
    """Writes other values into both forms of the plan, as a careful forger would."""
    plan = changed(Plan.load(directory / "plan.npz"), **changes)
    plan.save_npz(directory / "plan.npz")
    plan.save_json(directory / "plan.json")


def test_an_untouched_fold_is_verified_again(directory: FilePath) -> None:
    found = verify(directory)
    assert found.verified
    assert found.problems == ()
    plan = Plan.load(directory / "plan.npz")
    assert found.certificate.min_clearance == plan.certificate.min_clearance
    assert found.replay is not None
    assert found.replay.pose_difference < 1e-9
    assert found.replay.overlap == 0.0
    assert found.replay.frames == 2 * len(plan.time_s) - 1
    json.dumps(found.as_dict(), allow_nan=False)


def test_a_forged_verdict_helps_nobody(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    angles = plan.joint_angles_rad.copy()
    angles[60] = ROLLED_UP
    rewrite(directory, joint_angles_rad=angles)
    assert Plan.load(directory / "plan.npz").verified
    found = verify(directory)
    assert not found.verified
    assert any("in the plan, modules" in problem for problem in found.problems)
    assert any("MuJoCo finds an overlap" in problem for problem in found.problems)


def test_two_forms_that_differ_are_noticed(directory: FilePath) -> None:
    values = json.loads((directory / "plan.json").read_text())
    values["joint_angles_rad"][40][3] += 1e-6
    (directory / "plan.json").write_text(json.dumps(values))
    assert "plan.json and plan.npz differ in joint_angles_rad" in verify(directory).problems[0]


@pytest.mark.parametrize("name", ["joint_angles_rad", "root_position", "root_wxyz", "time_s"])
def test_a_plan_with_holes_is_refused(name: str, directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    values = getattr(plan, name).copy()
    values[30] = np.nan
    rewrite(directory, **{name: values})
    assert not verify(directory).verified


def test_larger_modules_are_asked_about(directory: FilePath) -> None:
    found = verify(directory, module_size=1.04)
    assert not found.verified
    assert any("module size 1.04" in problem for problem in found.problems)


def test_a_model_with_other_joints_is_noticed(directory: FilePath) -> None:
    path = directory / "model.xml"
    text = path.read_text()
    assert 'axis="0 1 0"' in text
    path.write_text(text.replace('axis="0 1 0"', 'axis="0 -1 0"', 1))
    assert any("poses differ" in problem for problem in verify(directory).problems)


@pytest.mark.parametrize("data", [b"", b"<mujoco/>", b"not xml", b"\xff\xfe\x00"])
def test_a_model_that_is_none_is_refused(data: bytes, directory: FilePath) -> None:
    (directory / "model.xml").write_bytes(data)
    with pytest.raises(InputError, match="model"):
        verify(directory)


@pytest.mark.parametrize("name", ["plan.npz", "plan.json", "model.xml"])
def test_a_missing_file_is_named(name: str, directory: FilePath) -> None:
    (directory / name).unlink()
    with pytest.raises(InputError, match=name):
        verify(directory)


def test_a_missing_timeline_is_said(directory: FilePath) -> None:
    shutil.rmtree(directory / "timeline.zarr")
    with pytest.raises(TimelineError):
        verify(directory)


@pytest.mark.parametrize("part", ["playback", "explosion"])
@pytest.mark.parametrize("value", [{"status": "folded"}, {"beauty": 1}, [1, 2], "folded"])
def test_results_of_another_kind_are_refused(part: str, value: Any, directory: FilePath) -> None:
    rewrite(directory, **{part: value})
    with pytest.raises(InputError):
        verify(directory)


def test_a_plan_without_its_playback_is_not_verified(directory: FilePath) -> None:
    rewrite(directory, playback=None)
    assert not verify(directory).verified


def test_frames_that_are_not_the_timelines_are_refused(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    rewrite(
        directory,
        **{
            name: getattr(plan, name)[:-5]
            for name in (
                "time_s",
                "phase",
                "joint_angles_rad",
                "root_position",
                "root_wxyz",
                "max_error_rad",
            )
        },
    )
    with pytest.raises(InputError, match="timeline"):
        verify(directory)


def test_replay_finds_a_deep_overlap_where_it_is(folded: Callable[..., Any]) -> None:
    fold = folded("wrench-24")
    angles = fold.plan.joint_angles_rad.copy()
    angles[50] = ROLLED_UP
    xml = (fold.directory / "model.xml").read_text()
    found = replay(changed(fold.plan, joint_angles_rad=angles), xml)
    assert found.overlap > 0.1
    assert found.overlap_frame is not None
    assert 49.0 <= found.overlap_frame <= 51.0
