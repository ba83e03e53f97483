from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest
import zarr

from planner.certificate.certificate import Place, certify
from planner.certificate.verdict import KINEMATICS_ONLY, SIMULATED
from planner.chain.path import Path
from planner.errors import InputError, TimelineError
from planner.exports import mjcf
from planner.files import write_json
from planner.motion.inverse import inverse_dynamics
from planner.motion.timeline import TimelineWriter
from planner.parameters.playback import PlaybackParameters
from planner.pipeline.manifest import write_manifest
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_path
from planner.verification.replay import replay
from planner.verification.verify import verify
from tests.planner.chains import COIL
from tests.planner.plans import changed
from tests.planner.tampering import reseal

LATER = (
    "exempt_pairs",
    "min_clearance_record_at",
    "frames",
    "plan_end_error_rad",
    "max_angle_rad",
    "max_angle_record_rad",
    "torque_source",
    "torque_frames",
)
"""Fields that certificates of earlier versions did not have."""
KINEMATIC = "simulated_modules=2"
"""Settings with which nothing longer is simulated."""
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


def parent(values: Any, at: tuple[str, ...]) -> Any:
    for key in at[:-1]:
        values = values[key]
    return values


def edit_plan(directory: FilePath, change: Callable[[dict[str, Any]], Any]) -> None:
    """Changes what is not an array in all copies of a plan."""
    values = json.loads((directory / "plan.json").read_bytes())
    change(values)
    (directory / "plan.json").write_text(json.dumps(values))
    with np.load(directory / "plan.npz") as file:
        arrays = dict(file)
    values = json.loads(str(arrays["plan"]))
    change(values)
    arrays["plan"] = np.array(json.dumps(values))
    np.savez_compressed(directory / "plan.npz", **arrays)
    (directory / "certificate.json").write_text(json.dumps(values["certificate"]))


def of_earlier(directory: FilePath) -> None:
    """Turns a fold into one as earlier versions left it."""

    def change(values: dict[str, Any]) -> None:
        values["format"] = "foldback-plan/1"
        for name in ("motion", "angles"):
            del values[name]
        values["certificate"]["verdict"] = "verified"
        for name in ("simulated", *LATER):
            del values["certificate"][name]

    edit_plan(directory, change)
    (directory / "manifest.json").unlink()


def test_an_untouched_fold_is_verified_again(directory: FilePath) -> None:
    found = verify(directory)
    assert found.verified
    assert found.problems == ()
    plan = Plan.load(directory / "plan.npz")
    assert found.certificate.min_clearance == plan.certificate.min_clearance
    assert found.replay.pose_difference < 1e-9
    assert found.replay.overlap == 0.0
    assert found.replay.frames == 2 * len(plan.time_s) - 1
    json.dumps(found.as_dict(), allow_nan=False)


def test_what_was_left_out_is_said(directory: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.verification.replay.MAX_REPLAYED_MODULES", 148 * 24 // 2)
    checked = verify(directory).checked
    assert "plain MuJoCo has the same poses and finds no overlap at one frame in 2" in checked
    assert any("except simulated torques" in line for line in checked)
    assert any("the only check of figures.zarr (plots)" in line for line in checked)


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
    assert "failed: plan.json: joint_angles_rad: it was changed" in problems


def test_a_fold_without_digests_is_checked_as_far_as_it_goes(directory: FilePath) -> None:
    """As earlier versions left it."""
    of_earlier(directory)
    found = verify(directory)
    assert found.problems == ()
    assert any("no manifest.json" in note for note in found.notes)
    assert any("The certificate is from an earlier version" in note for note in found.notes)
    path = directory / "certificate.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "min_clearance": 0.5}))
    problem = verify(directory).problems[0]
    assert problem.startswith("failed: certificate.json and plan.npz differ in")
    assert "certificate.min_clearance: got 0.5, expected" in problem


def test_a_plan_of_today_has_its_digests(directory: FilePath) -> None:
    (directory / "manifest.json").unlink()
    (problem,) = verify(directory).problems
    assert problem.startswith("failed: manifest.json: it is missing")


@pytest.mark.parametrize(
    ("at", "field"),
    [
        (("certificate", "simulated"), "plan.npz.certificate.simulated"),
        (("certificate", "torque_frames"), "torque_frames"),
        (("playback", "kind"), "plan.npz.playback.kind"),
        (("explosion", "strategy"), "plan.npz.explosion.strategy"),
        (("attempts",), "plan.npz.attempts"),
        (("angles",), "plan.npz.angles"),
    ],
)
def test_a_field_that_is_gone_everywhere_is_told(
    at: tuple[str, ...], field: str, directory: FilePath
) -> None:
    """A plan of today is not let off as one of earlier versions, which had fewer fields."""
    edit_plan(directory, lambda values: parent(values, at).pop(at[-1]))
    write_manifest(directory)
    try:
        told = "\n".join(verify(directory).problems)
    except InputError as error:
        told = str(error)
    assert field in told


@pytest.mark.parametrize(
    "strategy", ["auto", *(pytest.param(s, marks=pytest.mark.long) for s in ("peel", "one-by-one"))]
)
@pytest.mark.parametrize("settings", ["", KINEMATIC])
def test_a_straight_line_has_no_torques_and_is_verified(
    strategy: str, settings: str, tmp_path: FilePath
) -> None:
    """Where it is not simulated, all of its frames are at one time, so none can be looked at."""
    straight = Path.from_cells([(k, 0, 0) for k in range(5)], name="line")
    Workspace(tmp_path).write_request(
        FoldRequest(strategy=strategy, settings=settings), write_path(straight)
    )
    run_stages(tmp_path)
    assert verify(tmp_path).problems == ()
    if settings:
        edit_plan(tmp_path, lambda values: values["playback"].update(rms_position_error=0.0))
        told = "\n".join(verify(tmp_path).problems)
        assert "plan.npz playback.rms_position_error: got 0.0, expected null" in told


def forge(directory: FilePath, **changes: Any) -> None:
    """Writes another playback into all files that tell of it, with a certificate and digests."""
    plan = Plan.load(directory / "plan.npz")
    recorded, old = Workspace(directory).read_record(), Workspace(directory).read_playback()
    assert old is not None
    playback = replace(old, **changes)
    parameters = Workspace(directory).read_request().parameters()
    certificate = certify(plan.chain, recorded, playback, parameters)
    forged = Plan.assembled(
        plan.chain, parameters, plan.seed, recorded, playback, certificate, plan.attempts
    )
    timeline = directory / "timeline.zarr"
    with TimelineWriter.reopen(timeline, frames=len(recorded.frames)) as writer:
        writer.append(playback.frames)
    playback.save(directory / "playback.npz")
    write_json(directory / "certificate.json", certificate.as_dict())
    forged.save_npz(directory / "plan.npz")
    forged.save_json(directory / "plan.json")
    (directory / "model.xml").write_bytes(mjcf.write(forged))
    write_manifest(directory)


@pytest.fixture
def peeled(hook: Path, tmp_path: FilePath) -> FilePath:
    """A fold that was not simulated."""
    Workspace(tmp_path).write_request(
        FoldRequest(strategy="peel", settings=KINEMATIC), write_path(hook)
    )
    run_stages(tmp_path)
    return tmp_path


def test_what_was_not_simulated_does_not_pass_for_simulated(peeled: FilePath) -> None:
    """Not even where everything that tells of it has been made to agree."""
    plan = Plan.load(peeled / "plan.npz")
    forge(
        peeled,
        kind="dynamic",
        steps=round(float(plan.time_s[-1]) / PlaybackParameters().step_s),
        rms_position_error=0.0,
        max_angle_error_rad=0.0,
        torque_frames=None,
    )
    assert Plan.load(peeled / "plan.npz").certificate.verdict == SIMULATED
    told = "\n".join(verify(peeled).problems)
    assert 'plan.npz playback.kind: got "dynamic", expected "kinematic"' in told


def test_only_the_baseline_goes_without_an_explosion(directory: FilePath) -> None:
    """Without one, a chain of any length would count as simulated."""
    rewrite(directory, explosion=None)
    (directory / "record.npz").unlink()
    write_manifest(directory)
    told = "\n".join(verify(directory).problems)
    assert "plan.npz explosion: expected its results with the preset default" in told


def test_nothing_is_off_what_was_not_simulated(peeled: FilePath) -> None:
    rewrite(peeled, max_error_rad=np.zeros(len(Plan.load(peeled / "plan.npz").motion)))
    write_manifest(peeled)
    assert "plan.npz max_error_rad[0]: got 0.0, expected NaN" in "\n".join(verify(peeled).problems)


def test_what_was_simulated_does_not_pass_for_kinematic(directory: FilePath) -> None:
    playback = Workspace(directory).read_playback()
    assert not playback.frames.is_windowed
    frames = playback.frames.with_columns(
        joint_angles_rad=playback.reference.joint_angles_rad,
        joint_error_rad=np.full_like(playback.frames.joint_error_rad, np.nan),
    )
    torques = inverse_dynamics(Plan.load(directory / "plan.npz").chain, frames)
    forge(
        directory,
        kind="kinematic",
        frames=frames,
        steps=0,
        rms_position_error=None,
        max_angle_error_rad=None,
        peak_torque=torques.peak,
        rms_torque=torques.rms,
        torque_frames=len(torques.frames),
    )
    assert Plan.load(directory / "plan.npz").certificate.verdict == KINEMATICS_ONLY
    told = "\n".join(verify(directory).problems)
    assert 'plan.npz playback.kind: got "kinematic", expected "dynamic"' in told


def test_a_reference_does_not_pass_for_a_simulation(directory: FilePath) -> None:
    """Of a kind that could have been simulated: what comes of one is never its reference."""
    playback = Workspace(directory).read_playback()
    assert not playback.frames.is_windowed
    errors = np.zeros_like(playback.frames.joint_error_rad)
    frames = playback.frames.with_columns(
        joint_angles_rad=playback.reference.joint_angles_rad, joint_error_rad=errors
    )
    forge(directory, frames=frames, rms_position_error=0.0, max_angle_error_rad=0.0)
    told = "\n".join(verify(directory).problems)
    assert "timeline.zarr joint angles: got exactly those of plan.npz" in told


@pytest.mark.parametrize(
    ("fold", "changes", "problem"),
    [
        ("directory", {"steps": 1}, "playback.steps: got 1, expected "),
        ("directory", {"torque_frames": 3}, "playback.torque_frames: got 3, expected null"),
        ("directory", {"max_angle_error_rad": None}, "playback.max_angle_error_rad: got null"),
        ("peeled", {"steps": 1}, "playback.steps: got 1, expected 0"),
        ("peeled", {"kind": "kinexmatic"}, 'playback.kind: got "kinexmatic", expected "kinematic"'),
    ],
)
def test_a_playback_has_the_figures_of_its_kind(
    fold: str, changes: dict[str, Any], problem: str, request: pytest.FixtureRequest
) -> None:
    place: FilePath = request.getfixturevalue(fold)
    forge(place, **changes)
    assert f"plan.npz {problem}" in "\n".join(verify(place).problems)


def test_damaged_numbers_are_told_without_a_warning(directory: FilePath) -> None:
    """A signalling NaN can't be widened without one."""
    errors: Any = zarr.open_array(str(directory / "timeline.zarr" / "joint_error_rad"), mode="r+")
    values = errors[:]
    values.view(np.uint32)[-1, 3] = 0x7FA00000
    errors[:] = values
    reseal(directory / "timeline.zarr")
    write_manifest(directory)
    assert "timeline.zarr and plan.npz differ in max_error_rad" in "\n".join(
        verify(directory).problems
    )


def test_joint_errors_are_those_of_the_simulated_angles(directory: FilePath) -> None:
    """In all copies: the largest errors of a frame, too, and the digests."""
    errors = zarr.open_array(str(directory / "timeline.zarr" / "joint_error_rad"), mode="r+")
    values: Any = errors[:]
    k = len(values) - 50
    values[k] *= 0.5
    errors[:] = values
    reseal(directory / "timeline.zarr")
    plan = Plan.load(directory / "plan.npz")
    largest = plan.max_error_rad.copy()
    largest[k - len(values)] = values[k].max()
    rewrite(directory, max_error_rad=largest)
    write_manifest(directory)
    told = "\n".join(verify(directory).problems)
    assert "timeline.zarr joint_error_rad[" in told
    assert "max_error_rad" not in told


def test_the_error_at_the_end_is_worked_out_anew(directory: FilePath) -> None:
    edit_plan(directory, lambda values: values["playback"].update(rms_position_error=1e-5))
    write_manifest(directory)
    told = "\n".join(verify(directory).problems)
    assert "plan.npz playback.rms_position_error: got 1e-05, expected" in told


@pytest.mark.slow
def test_a_place_that_is_as_near_will_do(directory: FilePath) -> None:
    """Which of two like places is the closest depends on the last digit."""
    plan = Plan.load(directory / "plan.npz")
    certificate, last = plan.certificate, len(plan.motion) - 1
    cells = np.rint(plan.chain.folded_poses.positions)
    i, j = next(
        (i, j)
        for j in range(24)
        for i in range(j - 1)
        if np.abs(cells[i] - cells[j]).sum() == 1
        and Place(frame=float(last), modules=(i, j)) != certificate.min_clearance_at
    )
    near, far = (Place(frame=float(at), modules=(i, j)) for at in (last, 0))

    def told(**changes: Any) -> str:
        forged = replace(certificate, **changes)
        edit_plan(directory, lambda values: values.update(certificate=forged.as_dict()))
        write_manifest(directory)
        return "\n".join(p for p in verify(directory).problems if "plan.npz certificate" in p)

    bound = certificate.clearance_bound
    assert told(min_clearance_at=near) == ""
    assert "min_clearance_at" in told(min_clearance_at=far)
    assert told(clearance_bound=bound * 0.9995, in_betweens=certificate.in_betweens + 1) == ""
    assert "clearance_bound" in told(clearance_bound=bound * 1.01)
    assert "in_betweens" in told(in_betweens=2 * certificate.in_betweens + 100)


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
    assert any(
        "model.xml: the model does not belong to this plan" in problem for problem in problems
    )


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


QUICK: Final = "radial_gain=5"
"""Settings with which a few modules explode in under a second."""


@pytest.mark.parametrize(
    "change", ["value", *(pytest.param(c, marks=pytest.mark.long) for c in ("fewer", "none"))]
)
def test_snapshots_that_were_changed_are_told(change: str, tmp_path: FilePath) -> None:
    request = FoldRequest(preset="paper", settings=QUICK)
    Workspace(tmp_path).write_request(request, write_path(COIL))
    run_stages(tmp_path)
    assert verify(tmp_path).problems == ()
    record = Workspace(tmp_path).read_record()
    snapshots = record.snapshots_rad.copy()
    snapshots[len(snapshots) // 2, 3] += 0.1
    found = {"value": snapshots, "fewer": snapshots[1:], "none": None}[change]
    replace(record, snapshots_rad=found).save(tmp_path / "record.npz")
    write_manifest(tmp_path)
    problems = verify(tmp_path).problems
    assert any("record.npz snapshots_rad" in problem for problem in problems), problems
