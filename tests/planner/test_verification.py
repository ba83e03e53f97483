from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.errors import InputError, TimelineError
from planner.manifest import write_manifest
from planner.plan import Plan
from planner.replay import replay
from planner.verification import verify
from tests.planner.plans import changed

ROLLED_UP = np.tile([np.pi / 2, 0.0], 22)
"""All modules of a chain of 24 in four cells."""
ALL_PAIRS = "".join(
    f'<exclude body1="module_{i}" body2="module_{j}"/>' for j in range(24) for i in range(j)
)


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
    problems = verify(directory).problems
    assert "plan.json and plan.npz differ in joint_angles_rad[40, 3]" in problems[0]
    assert "failed: plan.json: joint_angles_rad: it is not what was written" in problems


def test_a_fold_without_digests_is_checked_as_far_as_it_goes(directory: FilePath) -> None:
    """As earlier versions left it."""
    (directory / "manifest.json").unlink()
    found = verify(directory)
    assert found.verified and "manifest.json" in found.notes[0]
    path = directory / "certificate.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "min_clearance": 0.5}))
    (problem,) = verify(directory).problems
    assert problem.startswith("failed: certificate.json and plan.npz differ in")
    assert "certificate.min_clearance: got 0.5, expected" in problem


def test_the_plans_own_parameters_count(directory: FilePath) -> None:
    """Smaller modules than asked for would be clear by more."""
    plan = Plan.load(directory / "plan.npz")
    rewrite(directory, parameters={**plan.parameters, "module_size": 0.5})
    write_manifest(directory)
    found = verify(directory)
    assert found.certificate.module_size == 0.5
    told = "\n".join(found.problems)
    assert "plan.npz certificate.module_size: got 0.95, expected 0.5" in told
    assert "plan.npz parameters.module_size: got 0.5, expected 0.95" in told


def test_a_model_that_looks_away_is_noticed(directory: FilePath) -> None:
    """Of other sizes, or with more pairs that may lie in one another."""
    path, plan = directory / "model.xml", Plan.load(directory / "plan.npz")
    text = path.read_text()
    more = '<exclude body1="module_3" body2="module_9"/></contact>'
    for changed_text, words in (
        (text.replace('size="0.475 ', 'size="0.4 ', 1), "geom"),
        (text.replace("</contact>", more), "exclude"),
    ):
        assert changed_text != text
        path.write_text(changed_text)
        write_manifest(directory)
        problems = [p for p in verify(directory).problems if p.startswith("failed: model.xml: ")]
        assert any(words in problem for problem in problems)
    angles = plan.joint_angles_rad.copy()
    angles[50] = ROLLED_UP
    blind = re.sub(r"<contact>.*</contact>", f"<contact>{ALL_PAIRS}</contact>", text, flags=re.S)
    assert replay(changed(plan, joint_angles_rad=angles), blind).overlap > 0.1


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


@pytest.mark.parametrize("data", [b"", b"not xml", b"\xff\xfe\x00"])
def test_a_model_that_is_none_is_refused(data: bytes, directory: FilePath) -> None:
    (directory / "model.xml").write_bytes(data)
    with pytest.raises(InputError, match="model"):
        verify(directory)


def test_a_model_of_nothing_is_not_the_plans(directory: FilePath) -> None:
    (directory / "model.xml").write_bytes(b"<mujoco/>")
    problems = verify(directory).problems
    assert any("model.xml: the model is not one of this plan" in problem for problem in problems)


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
