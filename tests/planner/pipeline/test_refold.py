"""Refolds: from one shape via straight to another, in one simulation and one certificate."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.certificate.certificate import Place, certify
from foldback.planner.certificate.figures_store import Figures
from foldback.planner.certificate.frame_figures import write_figures
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.exports.formats import export_named
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.fold import fold, refold
from foldback.planner.pipeline.manifest import write_manifest
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.plan.steps import steps_of
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.playback.unfolding import check_fits
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.verification.verify import verify
from tests.planner.chains import COIL, HAIRPIN, SQUARE, line
from tests.planner.folds import falsify
from tests.planner.plans import with_values
from tests.refusal import refused

UNFOLDING = PHASES.index("unfolding")


@pytest.fixture(scope="module")
def square() -> Plan:
    """Plan of a square, from which refolds start."""
    return fold(SQUARE, strategy="simultaneous")


@pytest.fixture(scope="module")
def folder(square: Plan, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Directory of a square that becomes a hairpin; tests must not change it."""
    directory = tmp_path_factory.mktemp("refold")
    refold(square, HAIRPIN, directory=directory)
    complete(directory)
    return directory


@pytest.fixture(scope="module")
def plan(folder: FilePath) -> Plan:
    return Plan.load(folder / "plan.npz")


@pytest.fixture
def copy(folder: FilePath, tmp_path: FilePath) -> FilePath:
    """Refold that a test may tamper with."""
    shutil.copytree(folder, tmp_path / "refold")
    return tmp_path / "refold"


def straight(plan: Plan) -> int:
    return int((plan.phase == UNFOLDING).sum())


def test_refold_by_turns_rests_from_shape_to_shape(tmp_path: FilePath) -> None:
    plan = refold(fold(SQUARE, strategy="turns"), HAIRPIN, strategy="turns", at_once=1)
    assert plan.certificate.verdict == "verified (simulated)"
    bent = [np.count_nonzero(Chain.from_path(path).folded_rad) for path in (SQUARE, HAIRPIN)]
    steps = steps_of(plan)
    assert steps.turn_count == sum(bent)
    # Without a limit the first plan unfolds in fewer steps than turns.
    assert len(steps.steps) < sum(bent)
    assert max(len(step.turns) for step in steps.steps[-bent[1] :]) == 1
    assert not steps.rests_rad[-1 - bent[1]].any()
    plan.save_npz(tmp_path / "plan.npz")
    assert foldback_check.check(str(tmp_path / "plan.npz"))["verdict"] == "proved"


def test_motion_that_follows_turns_is_unfolded_without_rests() -> None:
    plan = refold(fold(SQUARE, strategy="turns"), HAIRPIN)
    assert plan.playback["rest_frames"]
    assert not plan.unfolding().rest_frames
    assert refold(plan, SQUARE).certificate.verdict == "verified (simulated)"


@pytest.mark.slow
def test_refold_is_verified_from_shape_to_shape(plan: Plan, folder: FilePath, square: Plan) -> None:
    assert plan.certificate.verdict == "verified (simulated)"
    assert (plan.start.name, plan.chain.name) == ("square", "hairpin")
    assert plan.summary()["refold"] == {
        "start": "square",
        "straight_frame": straight(plan),
        "straight_s": plan.time_s[straight(plan)],
        "frames": len(plan.time_s),
    }
    json.dumps(plan.summary(), allow_nan=False)
    angles = plan.joint_angles_rad
    np.testing.assert_allclose(angles[0], square.chain.folded_rad, atol=1e-9, rtol=0)
    np.testing.assert_allclose(angles[-1], plan.chain.folded_rad, atol=1e-9, rtol=0)
    cells = plan.chain.poses(angles[0], plan.root_position[0], plan.root_wxyz[0]).positions
    np.testing.assert_allclose(cells, square.chain.folded_poses.positions, atol=1e-9, rtol=0)
    timeline = Timeline.open(folder / "timeline")
    assert timeline.status == "complete"
    np.testing.assert_array_equal(timeline.frames().phase, plan.phase)
    np.testing.assert_array_equal(timeline.frames().root_position, plan.root_position)
    second_plan = Plan.load(folder / "plan.npz")
    np.testing.assert_array_equal(second_plan.phase, plan.phase)
    np.testing.assert_array_equal(second_plan.start.folded_rad, plan.start.folded_rad)
    lines = export_named("csv").write(plan).decode().splitlines()[1:]
    assert [line.split(",")[1] for line in lines] == [PHASES[k] for k in plan.phase]
    assert set(np.unique(plan.phase)) == {UNFOLDING, PHASES.index("playback")}


def test_refold_is_straight_in_between_and_nothing_jumps(plan: Plan, folder: FilePath) -> None:
    k = straight(plan)
    np.testing.assert_allclose(plan.joint_angles_rad[k - 1 : k + 1], 0.0, atol=1e-9, rtol=0)
    assert (np.diff(plan.time_s) > 0.0).all()
    assert (np.diff(plan.phase.astype(int)) != 0).sum() == 1
    frames = Playback.load(folder / "playback.npz").frames
    assert np.abs(frames.joint_angles_rad[k]).max() < 1e-4
    # The simulation is continuous: no position or angle is skipped.
    spans = np.diff(frames.time_s)
    for values in (frames.root_position, frames.root_wxyz, frames.joint_angles_rad):
        speeds = np.linalg.norm(np.diff(values, axis=0), axis=1) / spans
        assert speeds[k - 1] <= np.median(speeds)


def test_refold_floats_without_momentum(plan: Plan) -> None:
    """A chain that rotated slowly about its length would spin faster as it straightens."""
    modules = plan.chain.poses(plan.joint_angles_rad, plan.root_position, plan.root_wxyz)
    centres = modules.positions.mean(axis=1)
    # momentum of equal modules; those of a robot differ a little
    np.testing.assert_allclose(centres, np.broadcast_to(centres[0], centres.shape), atol=0.15)
    # While the straight chain waits, it moves only as far as friction lets a servo move it.
    k = straight(plan)
    for values in (plan.root_position, plan.root_wxyz):
        np.testing.assert_allclose(values[k], values[k - 1], atol=1e-3)


def test_errors_torques_and_time_are_of_both_halves(
    plan: Plan, folder: FilePath, square: Plan, tmp_path: FilePath
) -> None:
    assert np.isfinite(plan.max_error_rad).all()
    assert plan.max_error_rad[: straight(plan)].max() > 0.0
    alone, certificate = square.certificate, plan.certificate
    assert certificate.peak_torque_nm > 0.9 * alone.peak_torque_nm
    assert (certificate.fold_time_s or 0.0) > 1.35 * (alone.fold_time_s or np.inf)
    peaks = Figures.load(folder / "figures").peak_torque_nm
    assert np.isfinite(peaks).all()
    # The certificate checks every step and the figures only frames: they agree closely.
    assert peaks.max() == pytest.approx(certificate.peak_torque_nm, rel=0.35)
    # Without the certificate, the figures follow from the frames' own speed.
    write_figures(folder / "timeline", tmp_path / "alone", Parameters())
    np.testing.assert_allclose(Figures.load(tmp_path / "alone").peak_torque_nm, peaks, rtol=0.05)


def test_verify_names_missing_files(copy: FilePath) -> None:
    removed_files = ("start.json", "start.npz", "record.npz", "playback.npz", "certificate.json")
    for name in removed_files:
        (copy / name).unlink()
    verification = verify(copy)
    assert {re.split(":| is", p.removeprefix("failed: "))[0] for p in verification.problems} == set(
        removed_files
    )
    assert all("is missing" in problem for problem in verification.problems)
    write_manifest(copy)
    (problem,) = verify(copy).problems
    assert "record.npz is missing, so the figures" in problem
    assert verification.replay.overlap == 0.0
    assert verification.replay.pose_difference < 1e-9


@pytest.mark.slow
def test_verify_finds_another_start_or_motion_of_a_refold(copy: FilePath, plan: Plan) -> None:
    k = straight(plan)

    def tampered(**changes: Any) -> str:
        forged = with_values(plan, **changes)
        forged.save_npz(copy / "plan.npz")
        return "\n".join(verify(copy).as_dict()["problems"])

    def with_row(row: int, values: Any) -> str:
        angles = plan.joint_angles_rad.copy()
        angles[row] = values
        return tampered(joint_angles_rad=angles)

    assert "does not start in the folded shape of hairpin" in tampered(start=plan.chain)
    assert tampered(start=None)
    assert "differ in the type or the number of their modules" in tampered(start=line(9))
    assert "does not become straight" in with_row(k, 0.01)
    for row in (k // 2, k + k // 2):
        problems = with_row(row, np.tile([np.pi / 2, 0.0], 6))
        assert "in the plan, modules" in problems
        assert "MuJoCo finds an overlap" in problems
    phase = plan.phase.copy()
    phase[k] = UNFOLDING
    with pytest.raises(InputError, match="phases"):
        tampered(phase=phase)
    plan.save_npz(copy / "plan.npz")
    replace(plan, start=plan.chain).save_json(copy / "plan.json")
    assert "plan.json and plan.npz differ in plan.start.name" in verify(copy).problems[0]


def test_certify_refuses_simulations_with_another_start_or_not_straight(
    folder: FilePath, plan: Plan
) -> None:
    playback = Playback.load(folder / "playback.npz")
    frames = playback.frames

    def verdict(start: Chain | None = plan.start, **columns: Any) -> str:
        other_settings = replace(playback, frames=frames.with_columns(**columns))
        return certify(plan.chain, None, other_settings, Parameters(), start=start).verdict

    assert verdict() == "verified (simulated)"
    moved = frames.root_position.copy()
    moved[0, 1] += 0.01
    late = np.vstack([frames.joint_angles_rad[1:2], frames.joint_angles_rad[1:]])
    assert "does not start in the folded shape of square" in verdict(root_position=moved)
    assert "does not start in the folded shape of square" in verdict(joint_angles_rad=late)
    angles = frames.joint_angles_rad.copy()
    angles[straight(plan)] = 0.05
    assert "at the straight shape" in verdict(joint_angles_rad=angles)
    assert "in the wrong order" in verdict(start=None)


@pytest.mark.slow
def test_refold_of_a_refold(plan: Plan, square: Plan) -> None:
    way = plan.unfolding()
    assert way.chain.name == "hairpin"
    assert way.time_s[0] == 0.0
    assert len(way.folding_rad) == len(plan.time_s) - straight(plan)
    np.testing.assert_allclose(way.folding_rad[0], 0.0, atol=1e-9)
    restored_refold = refold(plan, SQUARE)
    assert restored_refold.verified
    np.testing.assert_allclose(
        restored_refold.joint_angles_rad[-1], square.chain.folded_rad, atol=1e-9
    )


def test_refold_is_refused_before_anything_is_computed(square: Plan, tmp_path: FilePath) -> None:
    with refused("refold-differs", match="got a shape of 12 cubes, expected 8 cubes"):
        refold(square, COIL, directory=tmp_path)
    assert not (tmp_path / "timeline").exists()
    with pytest.raises(InputError, match="8 tetrahedra"):
        check_fits(square.chain, TETRAHEDRON, 8)
    with refused("refold-not-folded", match="does not start straight and end folded"):
        replace(square, motion=square.motion[:-3]).unfolding()


def test_refold_keeps_the_pitch_of_its_chain(square: Plan, tmp_path: FilePath) -> None:
    larger = replace(square, chain=replace(square.chain, pitch_m=0.05))
    Workspace(tmp_path).write_start(larger)
    Workspace(tmp_path).write_request(FoldRequest(refold=True), write_path(HAIRPIN))
    assert run_stage("read", tmp_path)["pitch_m"] == 0.05


@pytest.mark.slow
def test_other_paths_are_tried_for_an_overlap_in_the_second_half_only(
    copy: FilePath, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    for frame, again_kind in ((straight(plan) + 3.0, "explode"), (3.0, None)):
        falsify(
            monkeypatch,
            times=1,
            reason=Reason.of(ReasonCode.PLAN_END),
            min_clearance=-0.1,
            min_clearance_at=Place(frame=frame, modules=(0, 9)),
        )
        assert run_stage("certify", copy)["again"] == again_kind
        for stage in ("read", "explode", "play_back"):
            run_stage(stage, copy)


def test_long_chain_is_refolded_by_kinematics(square: Plan, folder: FilePath, plan: Plan) -> None:
    way = square.unfolding()
    parts: list[Motion] = []
    playback = play_back(
        plan.chain,
        Record.load(folder / "record.npz"),
        PlaybackParameters(simulated_modules=len(plan.chain) - 1),
        unfolding=way,
        sink=parts.append,
    )
    assert playback.kind == "kinematic"
    frames = Motion.joined(parts)
    assert np.isnan(frames.joint_error_rad).all()
    count = int((frames.phase == UNFOLDING).sum())
    np.testing.assert_array_equal(frames.joint_angles_rad[: count + 1], way.folding_rad[::-1])
    assert (np.diff(frames.time_s) > 0.0).all()
    certificate = certify(plan.chain, None, playback, Parameters(), start=square.chain)
    assert certificate.verdict == "verified (kinematics only)"
    centres = frames.poses(plan.chain).positions.mean(axis=1)
    np.testing.assert_allclose(centres, np.broadcast_to(centres[0], centres.shape), atol=1e-9)
