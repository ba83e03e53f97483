import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.certificate.certificate import Place, certify
from foldback.planner.certificate.figures import KINEMATICS_ONLY, SIMULATED
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.exports import mjcf
from foldback.planner.motion.inverse_dynamics import inverse_dynamics
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.pipeline import request
from foldback.planner.pipeline.manifest import write_manifest
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan, read_values
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.storage.files import write_json
from foldback.planner.verification.replay import replay
from foldback.planner.verification.verify import verify
from tests.golden.cases import HOOK
from tests.planner.chains import line
from tests.planner.folds import run_fold
from tests.planner.later_parameters import later
from tests.planner.plans import with_values
from tests.planner.tampering import edit_folder, edit_npz

KINEMATIC = "simulated_modules=2"
"""Setting by which longer chains are not simulated."""
ROLLED_UP = np.tile([np.pi / 2, 0.0], 22)
"""Angles that put all modules of a chain of 24 into four cells."""


@pytest.fixture
def directory(folded: Any, tmp_path: FilePath) -> FilePath:
    """Copy of a verified fold, which tests may tamper with."""
    shutil.copytree(folded.directory, tmp_path / "fold")
    return tmp_path / "fold"


def rewrite(directory: FilePath, plan: Plan | None = None, **changes: Any) -> None:
    """Write other values into a plan, as a careful forger would."""
    plan = with_values(plan or Plan.load(directory / "plan.npz"), **changes)
    plan.save_npz(directory / "plan.npz")


def findings(directory: FilePath, *, sealed: bool = True) -> str:
    """Return the problems that a verification finds, or its error; with new digests if sealed."""
    if sealed:
        write_manifest(directory)
    try:
        return "\n".join(verify(directory).problems)
    except (InputError, TimelineError) as error:
        return str(error)


def edit_plan(directory: FilePath, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change values other than arrays in all copies of a plan."""
    values = Plan.load(directory / "plan.npz").as_dict()
    change(values)
    edit_npz(directory / "plan.npz", lambda _, plan_values: change(plan_values))
    (directory / "certificate.json").write_text(json.dumps(values["certificate"]))


def test_untouched_fold_is_verified_again(
    directory: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    verification = verify(directory)
    assert verification.verified
    assert verification.problems == ()
    plan = Plan.load(directory / "plan.npz")
    assert verification.certificate.min_clearance == plan.certificate.min_clearance
    assert verification.replay.pose_difference < 1e-9
    assert verification.replay.overlap == 0.0
    assert verification.replay.frames == 2 * len(plan.time_s) - 1
    json.dumps(verification.as_dict(), allow_nan=False)
    monkeypatch.setattr("foldback.planner.verification.replay.MAX_REPLAYED_MODULES", 148 * 24 // 2)
    larger = verify(directory, module_size=1.04)
    assert not larger.verified
    assert "module size 1.04" in larger.as_dict()["problems"][0]
    note = "the replay in MuJoCo has the plan's poses and no overlap (checked at one frame in 2)"
    assert note in larger.checked
    assert any("folded the chain once more" in line for line in verification.checked)
    assert any("curves of the plots were computed again" in line for line in verification.checked)


def test_parameter_of_a_later_version_leaves_the_plan_verified(
    directory: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request, "preset", later)
    verification = verify(directory)
    assert verification.verified
    assert verification.problems == ()


def test_forged_verdict_is_refuted(directory: FilePath) -> None:
    angles = Plan.load(directory / "plan.npz").joint_angles_rad.copy()
    angles[60] = ROLLED_UP
    rewrite(directory, joint_angles_rad=angles)
    (directory / "manifest.json").unlink()
    assert Plan.load(directory / "plan.npz").verified
    verification = verify(directory)
    assert not verification.verified and "no overlap" not in str(verification.checked)
    problems = "\n".join(verification.as_dict()["problems"])
    for text in ("manifest.json, the file", "in the plan, modules", "MuJoCo finds an overlap"):
        assert text in problems
    assert verification.replay.overlap > 0.1
    assert 59.0 <= (verification.replay.overlap_frame or 0.0) <= 61.0


def test_copies_that_differ_are_found(directory: FilePath) -> None:
    values = Plan.load(directory / "plan.npz").as_dict()
    values["joint_angles_rad"][40][3] += 1e-6
    (directory / "plan.json").write_text(json.dumps(values))
    certificate = {**values["certificate"], "min_clearance": 0.5}
    (directory / "certificate.json").write_text(json.dumps(certificate))

    def forged(arrays: dict[str, Any]) -> None:
        if "joint_error_rad" in arrays:
            arrays["joint_error_rad"][-1, 3] = np.nan

    edit_folder(directory / "timeline", forged)
    finding_text = findings(directory, sealed=False)
    assert "timeline and plan.npz differ in max_error_rad" in finding_text
    assert "plan.json and plan.npz differ in joint_angles_rad[40, 3]" in finding_text
    assert "certificate.min_clearance: got 0.5, expected" in finding_text


def test_fields_missing_in_all_files_are_named(directory: FilePath) -> None:
    removed_fields = {"playback": ("kind",), "explosion": ("strategy",)}

    def remove(values: dict[str, Any]) -> None:
        for part, names in removed_fields.items():
            for name in names:
                del values[part][name]
        del values["angles"]

    edit_plan(directory, remove)
    finding_text = findings(directory)
    for part, names in (*removed_fields.items(), ("", ("angles",))):
        for name in names:
            assert f"plan.npz.{part}.{name}".replace("..", ".") in finding_text


@pytest.mark.parametrize("name", ["attempts", "likeness", "smoothing", "start", "certificate"])
def test_plan_without_a_field_is_refused(name: str, folded: Any) -> None:
    values = read_values(folded.directory / "plan.npz")
    del values[name]
    with pytest.raises(InputError, match=f"no readable plan .*{name}"):
        Plan.of_values(values, "plan.npz")


def test_straight_line_without_torques_is_verified(tmp_path: FilePath) -> None:
    """The line is not simulated: all frames have the same time, so torques cannot be computed."""
    run_fold(tmp_path, write_chain(line(5)), settings=KINEMATIC)
    assert verify(tmp_path).problems == ()


def forge(directory: FilePath, **changes: Any) -> None:
    """Write another playback into all files that report it, with a certificate and digests."""
    plan = Plan.load(directory / "plan.npz")
    recorded, old = Workspace(directory).read_record(), Workspace(directory).read_playback()
    assert old is not None
    playback = replace(old, **changes)
    parameters = Workspace(directory).read_request().parameters()
    certificate = certify(plan.chain, recorded, playback, parameters)
    forged = Plan.assembled(
        plan.chain, parameters, plan.seed, recorded, playback, certificate, plan.attempts
    )
    timeline = directory / "timeline"
    with TimelineWriter.reopen(timeline, frames=len(recorded.frames)) as writer:
        writer.append(playback.frames)
    playback.save(directory / "playback.npz")
    write_json(directory / "certificate.json", certificate.as_dict())
    forged.save_npz(directory / "plan.npz")
    (directory / "model.xml").write_bytes(mjcf.write(forged))
    write_manifest(directory)


@pytest.fixture(scope="module")
def kinematic(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Fold that was not simulated; tests must not change it."""
    place = tmp_path_factory.mktemp("kinematic") / "fold"
    run_fold(place, HOOK, strategy="peel", settings=KINEMATIC)
    return place


@pytest.fixture
def peeled(kinematic: FilePath, tmp_path: FilePath) -> FilePath:
    """Copy of the kinematic fold."""
    return FilePath(shutil.copytree(kinematic, tmp_path / "peeled"))


def test_kinematic_playback_does_not_pass_for_simulated(peeled: FilePath) -> None:
    """It does not pass even if all files that report it agree."""
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
    assert 'plan.npz playback.kind: got "dynamic", expected "kinematic"' in findings(peeled)


def test_reference_passes_neither_for_a_simulation_nor_for_kinematic(directory: FilePath) -> None:
    """A simulated playback never follows its reference exactly."""
    playback = Workspace(directory).read_playback()
    assert not playback.frames.is_windowed
    angles, still = playback.reference.joint_angles_rad, np.zeros_like(playback.reference_rad)
    frames = playback.frames.with_columns(joint_angles_rad=angles, joint_error_rad=still)
    forge(directory, frames=frames, rms_position_error=0.0, max_angle_error_rad=0.0)
    assert "timeline's joint angles: got exactly those of plan.npz" in findings(directory)
    frames = frames.with_columns(joint_error_rad=np.full_like(still, np.nan))
    torques = inverse_dynamics(Plan.load(directory / "plan.npz").chain, frames)
    none = dict.fromkeys(("rms_position_error", "max_angle_error_rad"))
    peaks = {"peak_torque": torques.peak, "rms_torque": torques.rms}
    count = len(torques.frames)
    forge(directory, kind="kinematic", frames=frames, steps=0, torque_frames=count, **none, **peaks)
    assert Plan.load(directory / "plan.npz").certificate.verdict == KINEMATICS_ONLY
    finding_text = findings(directory)
    assert 'plan.npz playback.kind: got "kinematic", expected "dynamic"' in finding_text


@pytest.mark.parametrize(
    ("fold", "changes", "expected"),
    [
        (
            "directory",
            {"steps": 1, "torque_frames": 3, "rms_position_error": 1e-5},
            {"torque_frames": "null"},
        ),
        (
            "peeled",
            {"steps": 1, "kind": "kinexmatic", "rms_position_error": 0.0},
            {"steps": "0", "kind": '"kinematic"', "rms_position_error": "null"},
        ),
        ("directory", {"max_angle_error_rad": None}, {}),
    ],
)
def test_playback_has_the_figures_of_its_kind(
    fold: str, changes: dict[str, Any], expected: dict[str, str], request: pytest.FixtureRequest
) -> None:
    place: FilePath = request.getfixturevalue(fold)
    forge(place, **changes)
    finding_text = findings(place)
    for name, value in changes.items():
        expected_words = f"expected {expected.get(name, '')}"
        assert (
            f"plan.npz playback.{name}: got {json.dumps(value)}, {expected_words}" in finding_text
        )


def test_forged_joint_errors_are_found(directory: FilePath) -> None:
    """The errors, their maxima per frame and the digests are forged in all copies."""
    plan = Plan.load(directory / "plan.npz")
    largest = plan.max_error_rad.copy()
    at_s = Timeline.open(directory / "timeline").clock()[0][-50]

    def forged(arrays: dict[str, Any]) -> None:
        for row in np.flatnonzero(arrays["time_s"] == at_s):
            arrays["joint_error_rad"][row] *= 0.5
            largest[-50] = arrays["joint_error_rad"][row].max()

    edit_folder(directory / "timeline", forged)
    rewrite(directory, max_error_rad=largest)
    finding_text = findings(directory)
    assert "timeline's joint_error_rad[" in finding_text
    assert "differ in max_error_rad" not in finding_text


@pytest.mark.slow
def test_certificate_may_name_another_place_that_is_as_near(directory: FilePath) -> None:
    """The choice between two equally close places depends on rounding."""
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
        finding_lines = findings(directory).split("\n")
        return "\n".join(line for line in finding_lines if "plan.npz certificate" in line)

    bound, looks = certificate.clearance_bound, certificate.in_betweens
    slightly = {"clearance_bound": bound * 0.9995, "in_betweens": looks + 1}
    assert with_certificate(min_clearance_at=near, **slightly) == ""
    much = {"clearance_bound": bound * 1.01, "in_betweens": 2 * looks + 100}
    changed_certificate = with_certificate(min_clearance_at=far, **much)
    for name in ("min_clearance_at", *much):
        assert f"certificate.{name}" in changed_certificate


def test_forged_models_are_found(directory: FilePath) -> None:
    """Other sizes, joints or exempt pairs; an empty model; a file that is no model."""
    path, plan = directory / "model.xml", Plan.load(directory / "plan.npz")
    text = forged = path.read_text()
    for old, new in (
        ('size="0.475 ', 'size="0.4 '),
        ("</contact>", '<exclude body1="module_3" body2="module_9"/></contact>'),
        ('axis="0 1 0"', 'axis="0 -1 0"'),
    ):
        assert old in forged
        forged = forged.replace(old, new, 1)
    path.write_text(forged)
    finding_text = findings(directory)
    for words in ("geom", "exclude"):
        assert re.search(f"failed: model.xml: .*{words}", finding_text)
    assert "poses differ" in finding_text
    path.write_bytes(b"<mujoco/>")
    assert "model.xml: the model does not belong to this plan" in findings(directory)
    path.write_bytes(b"\xff\xfe\x00")
    assert "model" in findings(directory)
    for data in ("", "not xml"):
        with pytest.raises(InputError, match="model"):
            replay(plan, data)
    angles = plan.joint_angles_rad.copy()
    angles[50] = ROLLED_UP
    names = [f"module_{i}" for i in range(24)]
    pairs = [f'<exclude body1="{a}" body2="{b}"/>' for a in names for b in names if a < b]
    blind = text.replace("</contact>", "".join(pairs) + "</contact>")
    assert replay(with_values(plan, joint_angles_rad=angles), blind).overlap > 0.1


def test_missing_files_and_frames_are_named(directory: FilePath) -> None:
    for name in ("plan.npz", "model.xml"):
        (directory / name).rename(directory / "away")
        assert name in findings(directory, sealed=False)
        (directory / "away").rename(directory / name)
    (directory / "playback.npz").unlink()
    assert findings(directory) == ""
    assert any("only the playback of the robot" in note for note in verify(directory).notes)
    (directory / "manifest.json").unlink()
    assert "manifest.json, the file with the digests" in findings(directory, sealed=False)
    plan = Plan.load(directory / "plan.npz")
    rewrite(directory, motion=plan.motion[:-5], max_error_rad=plan.max_error_rad[:-5])
    assert "timeline" in findings(directory, sealed=False)
    shutil.rmtree(directory / "timeline")
    with pytest.raises(TimelineError):
        verify(directory)


def test_forged_results_and_parameters_are_found(directory: FilePath) -> None:
    plan = Plan.load(directory / "plan.npz")
    for part, value in (
        ("playback", {"status": "folded"}),
        ("playback", [1, 2]),
        ("explosion", {"beauty": 1}),
        ("explosion", "folded"),
    ):
        rewrite(directory, plan, **{part: value})
        with pytest.raises(InputError):
            verify(directory)
    rewrite(directory, plan, playback=None)
    assert not verify(directory).verified
    # Smaller modules would have more clearance: the plan's own parameters count.
    smaller = {**plan.parameters, "module_size": 0.5}
    rewrite(directory, playback=plan.playback, parameters=smaller)
    finding_text = findings(directory)
    assert "plan.npz certificate.module_size: got 0.95, expected 0.5" in finding_text
    assert "plan.npz parameters.module_size: got 0.5, expected 0.95" in finding_text
    # Without an explosion, a chain of any length would count as simulated.
    rewrite(directory, parameters=plan.parameters, explosion=None)
    (directory / "record.npz").unlink()
    assert "plan.npz explosion: got null, expected results" in findings(directory)


def test_changed_snapshots_are_found(tmp_path: FilePath) -> None:
    run_fold(tmp_path, HOOK, preset="paper", settings="radial_gain=5")
    record = Workspace(tmp_path).read_record()
    snapshots = record.snapshots_rad.copy()
    snapshots[len(snapshots) // 2, 3] += 0.1
    for forged in (snapshots, None):
        replace(record, snapshots_rad=forged).save(tmp_path / "record.npz")
        assert "record.npz snapshots_rad" in findings(tmp_path)
