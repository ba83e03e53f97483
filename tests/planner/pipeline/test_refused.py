"""Of several plans that were refused the closest is shown, whatever comes after and is cut off."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.certificate.certificate import Certificate, Place, certify
from planner.explosion.simultaneous import explode
from planner.motion.record import Record
from planner.motion.timeline import Timeline
from planner.pipeline import refused
from planner.pipeline.ended import look_back
from planner.pipeline.fold_directory import write_request
from planner.pipeline.request import Request
from planner.pipeline.stages import next_stage, run_stage, run_stages
from planner.plan.formats import write_path
from planner.plan.plan import Plan
from planner.simulation.parameters import ExplosionParameters
from tests.planner.chains import COIL

pytestmark = pytest.mark.slow

LEFT = {"refused", "refused.part", "refused.back", "best.zarr", "best.part"}
Judge = Callable[..., Certificate]


def begun(directory: FilePath, **values: Any) -> FilePath:
    directory.mkdir()
    write_request(directory, Request(**values), write_path(COIL))
    return directory


def refusing(monkeypatch: pytest.MonkeyPatch, *clearances: float) -> None:
    """Certificates that refuse one plan after the other, by so much, and none after them."""
    due = list(clearances)

    def judge(*arguments: Any, **more: Any) -> Certificate:
        found = certify(*arguments, **more)
        if not due:
            return found
        return replace(
            found,
            verdict="failed: in the plan, modules 1 and 9 overlap",
            min_clearance=due.pop(0),
            min_clearance_at=Place(frame=3.0, modules=(1, 9)),
        )

    monkeypatch.setattr("planner.pipeline.stages.certify", judge)


def sticking(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """Explosions that stick after so many that don't."""
    made = 0

    def once(chain: Any, parameters: Any, **more: Any) -> Record:
        nonlocal made
        made += 1
        if made <= after:
            return explode(chain, parameters, **more)
        hasty = ExplosionParameters(max_steps=40)
        return replace(explode(chain, hasty, **more), status="stalled", reason="it sticks")

    monkeypatch.setattr("planner.explosion.strategies.explode", once)


@pytest.mark.slow
def test_a_refused_plan_is_shown_when_all_others_stick(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing(monkeypatch, -0.0004)
    sticking(monkeypatch, after=1)
    directory = begun(tmp_path / "fold", strategy="simultaneous")
    summary = run_stages(directory)
    assert (summary["status"], summary["stuck"]) == ("failed", None)
    assert "overlap" in summary["reason"]
    assert summary["certificate"]["min_clearance"] == -0.0004
    plan = Plan.load(directory / "plan.npz")
    assert len(plan.time_s) > 10
    assert [a["status"] for a in plan.attempts][:2] == ["straight", "stalled"]
    frames = summary["explosion"]["frames"] + len(plan.time_s)
    assert len(Timeline.open(directory / "timeline.zarr")) == frames
    assert not LEFT & {path.name for path in directory.iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("clearances", "shown"), [((-0.3, -0.1, -0.2, -0.2), 1), ((-0.1, -0.2, -0.3, -0.3), 0)]
)
def test_the_closest_of_the_refused_is_shown(
    clearances: tuple[float, ...],
    shown: int,
    tmp_path: FilePath,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refusing(monkeypatch, *clearances)
    directory = begun(tmp_path / "fold", strategy="simultaneous")
    summary = run_stages(directory)
    assert summary["certificate"]["min_clearance"] == clearances[shown]
    plan = Plan.load(directory / "plan.npz")
    anew = explode(plan.chain, Request().parameters().explosion, seed=shown)
    record = Record.load(directory / "record.npz")
    np.testing.assert_array_equal(record.frames.joint_angles_rad, anew.frames.joint_angles_rad)
    assert not LEFT & {path.name for path in directory.iterdir()}


@pytest.mark.slow
def test_nothing_is_left_when_a_later_one_is_verified(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing(monkeypatch, -0.1)
    directory = begun(tmp_path / "fold")
    assert run_stages(directory)["status"] == "verified"
    assert not LEFT & {path.name for path in directory.iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize("doubled", [4, 6, 7])
def test_a_stage_that_is_run_twice_changes_nothing(
    doubled: int, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a kill between its last file and the note of its end."""
    refusing(monkeypatch, -0.001)
    sticking(monkeypatch, after=1)
    directory = begun(tmp_path / "fold", strategy="simultaneous")
    stage: str | None = "read"
    number, result = 0, {}
    while stage is not None:
        result = run_stage(stage, directory)
        if number == doubled:
            result = run_stage(stage, directory)
        stage = next_stage(stage, result)
        number += 1
    assert number == 8
    assert result["certificate"]["min_clearance"] == -0.001
    assert len(Plan.load(directory / "plan.npz").time_s) > 10


def test_a_cancel_while_others_are_tried_leaves_the_refused_one(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing(monkeypatch, -0.001)
    directory = begun(tmp_path / "fold")
    for stage in ("read", "explode", "play_back", "certify"):
        run_stage(stage, directory)
    frames = len(Timeline.open(directory / "timeline.zarr"))
    run_stage("explode", directory, cancelled=lambda: True)
    assert len(Timeline.open(directory / "timeline.zarr")) < frames
    told = look_back(directory)
    assert told["certificate"]["min_clearance"] == -0.001
    assert told["explosion"]["status"] == "straight"
    assert len(Timeline.open(directory / "timeline.zarr")) == frames
    assert not LEFT & {path.name for path in directory.iterdir()}


def files(place: FilePath, clearance: float) -> None:
    place.mkdir(exist_ok=True)
    certificate = {"min_clearance": clearance, "min_clearance_playback": 0.0}
    (place / "certificate.json").write_text(json.dumps(certificate))
    for name in ("chain.json", "record.npz", "playback.npz"):
        (place / name).write_text(str(clearance))
    (place / "timeline.zarr").mkdir(exist_ok=True)
    (place / "timeline.zarr" / "zarr.json").write_text(str(clearance))


@pytest.mark.parametrize("call", range(12))
def test_what_is_cut_off_at_any_rename_goes_on(
    call: int, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Put aside and brought back, each cut off once before some rename."""
    calls = 0
    rename, over = FilePath.rename, FilePath.replace

    def cut(original: Callable[..., Any]) -> Callable[..., Any]:
        def moved(*arguments: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == call + 1:
                raise KeyboardInterrupt
            return original(*arguments)

        return moved

    monkeypatch.setattr(FilePath, "rename", cut(rename))
    monkeypatch.setattr(FilePath, "replace", cut(over))

    def patiently(do: Callable[[], Any]) -> Any:
        try:
            return do()
        except KeyboardInterrupt:
            return do()

    files(tmp_path, -0.1)
    patiently(lambda: refused.put_aside(tmp_path))
    assert not (tmp_path / "record.npz").exists() and not (tmp_path / "timeline.zarr").exists()
    assert (tmp_path / "chain.json").exists()
    (tmp_path / "timeline.zarr").mkdir()
    (tmp_path / "certificate.json").write_text("{}")
    assert patiently(lambda: refused.bring_back(tmp_path))
    for name in ("chain.json", "record.npz", "playback.npz", "timeline.zarr/zarr.json"):
        assert (tmp_path / name).read_text() == "-0.1"
    refused.drop(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("certificate.json", "chain.json", "record.npz", "playback.npz", "timeline.zarr")
    }
