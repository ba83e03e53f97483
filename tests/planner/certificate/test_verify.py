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
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain, write_path
from planner.verification.replay import replay
from planner.verification.verify import verify
from tests.planner.chains import line
from tests.planner.folds import made
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


def told(directory: FilePath, *, sealed: bool = True) -> str:
    """Return what a verification finds, the digests worked out anew if sealed."""
    if sealed:
        write_manifest(directory)
    return "\n".join(verify(directory).problems)


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


def test_untouched_fold_is_verified_again(
    directory: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = verify(directory)
    assert found.verified
    assert found.problems == ()
    plan = Plan.load(directory / "plan.npz")
    assert found.certificate.min_clearance == plan.certificate.min_clearance
    assert found.replay.pose_difference < 1e-9
    assert found.replay.overlap == 0.0
    assert found.replay.frames == 2 * len(plan.time_s) - 1
    json.dumps(found.as_dict(), allow_nan=False)
    larger = verify(directory, module_size=1.04)
    assert not larger.verified
    assert any("module size 1.04" in problem for problem in larger.problems)
    monkeypatch.setattr("planner.verification.replay.MAX_REPLAYED_MODULES", 148 * 24 // 2)
    checked = verify(directory).checked
    assert "plain MuJoCo has the same poses and finds no overlap at one frame in 2" in checked
    assert any("except simulated torques" in line for line in checked)
    assert any("the only check of figures.zarr (plots)" in line for line in checked)


def test_forged_verdict_is_refuted(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    angles = plan.joint_angles_rad.copy()
    angles[60] = ROLLED_UP
    rewrite(directory, joint_angles_rad=angles)
    assert Plan.load(directory / "plan.npz").verified
    found = verify(directory)
    assert not found.verified
    assert any("in the plan, modules" in problem for problem in found.problems)
    assert any("MuJoCo finds an overlap" in problem for problem in found.problems)
    assert found.replay.overlap > 0.1
    assert 59.0 <= (found.replay.overlap_frame or 0.0) <= 61.0


def test_different_forms_of_the_plan_are_found(directory: FilePath) -> None:
    values = json.loads((directory / "plan.json").read_text())
    values["joint_angles_rad"][40][3] += 1e-6
    (directory / "plan.json").write_text(json.dumps(values))
    problems = verify(directory).problems
    assert "plan.json and plan.npz differ in joint_angles_rad[40, 3]" in problems[0]
    assert "failed: plan.json: joint_angles_rad: it was changed" in problems


def test_fold_of_an_earlier_version_is_verified(directory: FilePath) -> None:
    digests = (directory / "manifest.json").read_bytes()
    (directory / "manifest.json").unlink()
    assert told(directory, sealed=False).startswith("failed: manifest.json: it is missing")
    (directory / "manifest.json").write_bytes(digests)
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
def test_field_missing_in_all_files_is_named(
    at: tuple[str, ...], field: str, directory: FilePath
) -> None:
    """A plan of today is not let off as one of earlier versions, which had fewer fields."""

    def remove(values: dict[str, Any]) -> None:
        held = values if len(at) == 1 else values[at[0]]
        del held[at[-1]]

    edit_plan(directory, remove)
    try:
        found = told(directory)
    except InputError as error:
        found = str(error)
    assert field in found


@pytest.mark.parametrize("settings", ["", KINEMATIC])
def test_straight_line_without_torques_is_verified(settings: str, tmp_path: FilePath) -> None:
    """Where it is not simulated, all of its frames are at one time, so none can be looked at."""
    made(tmp_path, write_chain(line(5)), settings=settings)
    assert verify(tmp_path).problems == ()
    if settings:
        edit_plan(tmp_path, lambda values: values["playback"].update(rms_position_error=0.0))
        found = told(tmp_path, sealed=False)
        assert "plan.npz playback.rms_position_error: got 0.0, expected null" in found


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
    made(tmp_path, write_path(hook), strategy="peel", settings=KINEMATIC)
    return tmp_path


def test_kinematic_playback_does_not_pass_for_simulated(peeled: FilePath) -> None:
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
    found = told(peeled)
    assert 'plan.npz playback.kind: got "dynamic", expected "kinematic"' in found


def test_simulated_playback_does_not_pass_for_kinematic(directory: FilePath) -> None:
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
    found = told(directory)
    assert 'plan.npz playback.kind: got "kinematic", expected "dynamic"' in found


def test_reference_does_not_pass_for_a_simulation(directory: FilePath) -> None:
    """Of a kind that could have been simulated: what comes of one is never its reference."""
    playback = Workspace(directory).read_playback()
    assert not playback.frames.is_windowed
    errors = np.zeros_like(playback.frames.joint_error_rad)
    frames = playback.frames.with_columns(
        joint_angles_rad=playback.reference.joint_angles_rad, joint_error_rad=errors
    )
    forge(directory, frames=frames, rms_position_error=0.0, max_angle_error_rad=0.0)
    assert "timeline.zarr joint angles: got exactly those of plan.npz" in told(directory)


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
def test_playback_has_the_figures_of_its_kind(
    fold: str, changes: dict[str, Any], problem: str, request: pytest.FixtureRequest
) -> None:
    place: FilePath = request.getfixturevalue(fold)
    forge(place, **changes)
    assert f"plan.npz {problem}" in told(place)


def test_signalling_nan_is_found_without_a_warning(directory: FilePath) -> None:
    """A signalling NaN can't be widened without one."""
    errors: Any = zarr.open_array(str(directory / "timeline.zarr" / "joint_error_rad"), mode="r+")
    values = errors[:]
    values.view(np.uint32)[-1, 3] = 0x7FA00000
    errors[:] = values
    reseal(directory / "timeline.zarr")
    assert "timeline.zarr and plan.npz differ in max_error_rad" in told(directory)


def test_forged_joint_errors_are_found(directory: FilePath) -> None:
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
    found = told(directory)
    assert "timeline.zarr joint_error_rad[" in found
    assert "max_error_rad" not in found


@pytest.mark.slow
def test_certificate_may_name_another_place_that_is_as_near(directory: FilePath) -> None:
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

    def with_certificate(**changes: Any) -> str:
        forged = replace(certificate, **changes)
        edit_plan(directory, lambda values: values.update(certificate=forged.as_dict()))
        found = told(directory).split("\n")
        return "\n".join(line for line in found if "plan.npz certificate" in line)

    bound, looks = certificate.clearance_bound, certificate.in_betweens
    assert with_certificate(min_clearance_at=near) == ""
    assert "min_clearance_at" in with_certificate(min_clearance_at=far)
    assert with_certificate(clearance_bound=bound * 0.9995, in_betweens=looks + 1) == ""
    assert "clearance_bound" in with_certificate(clearance_bound=bound * 1.01)
    assert "in_betweens" in with_certificate(in_betweens=2 * looks + 100)


def test_forged_models_are_found(directory: FilePath) -> None:
    """Other sizes, joints or exempt pairs; none at all; or a file that is no model."""
    path, plan = directory / "model.xml", Plan.load(directory / "plan.npz")
    text = path.read_text()
    more = '<exclude body1="module_3" body2="module_9"/></contact>'
    for changed_text, words in (
        (text.replace('size="0.475 ', 'size="0.4 ', 1), "geom"),
        (text.replace("</contact>", more), "exclude"),
    ):
        assert changed_text != text
        path.write_text(changed_text)
        found = told(directory).split("\n")
        assert any(words in line for line in found if line.startswith("failed: model.xml: "))
    assert 'axis="0 1 0"' in text
    path.write_text(text.replace('axis="0 1 0"', 'axis="0 -1 0"', 1))
    assert "poses differ" in told(directory)
    path.write_bytes(b"<mujoco/>")
    assert "model.xml: the model does not belong to this plan" in told(directory)
    for data in (b"", b"not xml", b"\xff\xfe\x00"):
        path.write_bytes(data)
        with pytest.raises(InputError, match="model"):
            verify(directory)
    angles = plan.joint_angles_rad.copy()
    angles[50] = ROLLED_UP
    blind = re.sub(r"<contact>.*</contact>", f"<contact>{ALL_PAIRS}</contact>", text, flags=re.S)
    assert replay(changed(plan, joint_angles_rad=angles), blind).overlap > 0.1


@pytest.mark.parametrize("name", ["joint_angles_rad", "root_position", "root_wxyz", "time_s"])
def test_plan_with_numbers_that_are_not_finite_is_refused(name: str, directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    values = getattr(plan, name).copy()
    values[30] = np.nan
    rewrite(directory, **{name: values})
    assert not verify(directory).verified


@pytest.mark.parametrize("name", ["plan.npz", "plan.json", "model.xml"])
def test_missing_file_is_named(name: str, directory: FilePath) -> None:
    (directory / name).unlink()
    with pytest.raises(InputError, match=name):
        verify(directory)


def test_forged_results_and_parameters_are_found(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    for part in ("playback", "explosion"):
        for value in ({"status": "folded"}, {"beauty": 1}, [1, 2], "folded"):
            rewrite(directory, **{part: value})
            with pytest.raises(InputError):
                verify(directory)
            rewrite(directory, **{part: getattr(plan, part)})
    rewrite(directory, playback=None)
    assert not verify(directory).verified
    rewrite(directory, playback=plan.playback)
    edit_plan(directory, lambda values: values["playback"].update(rms_position_error=1e-5))
    found = told(directory)
    assert "plan.npz playback.rms_position_error: got 1e-05, expected" in found
    # Smaller modules than asked for would be clear by more: the plan's own parameters count.
    smaller = {**plan.parameters, "module_size": 0.5}
    rewrite(directory, playback=plan.playback, parameters=smaller)
    found = told(directory)
    assert "plan.npz certificate.module_size: got 0.95, expected 0.5" in found
    assert "plan.npz parameters.module_size: got 0.5, expected 0.95" in found
    # Without an explosion, a chain of any length would count as simulated.
    rewrite(directory, parameters=plan.parameters, explosion=None)
    (directory / "record.npz").unlink()
    assert "plan.npz explosion: expected its results with the preset default" in told(directory)


def test_missing_frames_or_timeline_are_refused(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    shorter = {"motion": plan.motion[:-5], "max_error_rad": plan.max_error_rad[:-5]}
    rewrite(directory, **shorter)
    with pytest.raises(InputError, match="timeline"):
        verify(directory)
    shutil.rmtree(directory / "timeline.zarr")
    with pytest.raises(TimelineError):
        verify(directory)


QUICK: Final = "radial_gain=5"
"""Settings with which a few modules explode in under a second."""


def test_changed_snapshots_are_found(tmp_path: FilePath) -> None:
    made(tmp_path, preset="paper", settings=QUICK)
    assert verify(tmp_path).problems == ()
    record = Workspace(tmp_path).read_record()
    snapshots = record.snapshots_rad.copy()
    snapshots[len(snapshots) // 2, 3] += 0.1
    for found in (snapshots, snapshots[1:], None):
        replace(record, snapshots_rad=found).save(tmp_path / "record.npz")
        assert "record.npz snapshots_rad" in told(tmp_path)
