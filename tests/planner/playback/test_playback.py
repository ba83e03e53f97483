from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from foldback.planner.certificate.certificate import certify
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.motion.angle_encoding import PLAN_STEP_RAD
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.parameters import Parameters, preset
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.playback.robot_run import STEPS_AT_ONCE
from foldback.planner.progress import Progress
from foldback.planner.simulation.mujoco_tree import Tree
from tests.planner.conftest import Folded
from tests.planner.folds import intercept
from tests.refusal import refused

DEFAULT = PlaybackParameters()
IDEAL = PlaybackParameters(controller="computed-torque")


def play(folded: Folded, parameters: PlaybackParameters, **options: Any) -> Playback:
    return play_back(folded.chain, folded.record, parameters, **options)


def test_robots_fold_a_real_shape(folded: Folded) -> None:
    playback, record = folded.playback, folded.record
    assert playback.status == "folded"
    assert playback.rms_position_error <= 1e-3
    assert playback.max_angle_error_rad <= 2e-3
    frames = playback.frames
    last = frames.joint_angles_rad[-1]
    ends = folded.chain.poses(last, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    distances = aligned_distances(ends.positions, folded.chain.folded_poses.positions)
    assert np.sqrt((distances**2).mean()) == pytest.approx(playback.rms_position_error, abs=1e-12)
    assert set(frames.phase.tolist()) == {1}
    assert (np.diff(frames.time_s) > 0).all()
    np.testing.assert_allclose(
        frames.joint_error_rad,
        np.abs(playback.reference_rad - frames.joint_angles_rad),
        # The reference is rounded to whole steps of angles when it becomes the plan.
        atol=0.5 * PLAN_STEP_RAD + 1e-15,
    )
    assert frames.joint_error_rad.max() <= playback.max_angle_error_rad + 1e-15
    # It starts at rest, in the last configuration of the record.
    np.testing.assert_array_equal(frames.joint_angles_rad[0], 0.0)
    np.testing.assert_array_equal(frames.root_position[0], record.frames.root_position[-1])
    np.testing.assert_allclose(frames.root_wxyz[0], record.frames.root_wxyz[-1], atol=1e-12)
    assert frames.time_s[0] == record.frames.time_s[-1]


def test_weak_motors_miss_the_target(folded: Folded) -> None:
    weak = replace(DEFAULT, robot=RobotParameters(motor_limit=0.3))
    playback = play(folded, weak)
    assert playback.status == "missed"
    assert "a robot could not follow the motion: " in str(playback.reason)
    assert playback.rms_position_error > 0.1
    ideal = play(folded, IDEAL)
    assert playback.peak_torque <= 0.31 * ideal.peak_torque
    certificate = certify(folded.chain, folded.record, playback, Parameters())
    assert not certificate.verified


def test_coarse_encoders_make_the_ideal_robot_less_exact(folded: Folded) -> None:
    coarse = replace(IDEAL, robot=RobotParameters(encoder_step=0.02))
    assert play(folded, coarse).max_angle_error_rad > play(folded, IDEAL).max_angle_error_rad


def test_torques_that_are_not_finite_end_the_playback(
    folded: Folded, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(number: int, original: Any, tree: Tree, torques: Any) -> None:
        original(tree, torques * np.nan if number > 100 else torques)

    intercept(monkeypatch, Tree, "apply_torques", broken)
    playback = play(folded, IDEAL)
    assert playback.status == "diverged"
    assert "finite" in str(playback.reason)
    assert playback.steps == 100
    assert len(playback.frames) > 3
    for name in ("joint_angles_rad", "root_position", "root_wxyz", "joint_error_rad"):
        assert np.isfinite(getattr(playback.frames, name)).all()
    assert np.isfinite(playback.rms_position_error)
    assert playback.rms_position_error > 0.1
    assert np.isfinite(playback.peak_torque)


def test_cancelled_or_too_long_playback_keeps_its_frames(folded: Folded) -> None:
    answers = iter((False, False, False, True))
    playback = play(folded, DEFAULT, cancelled=lambda: next(answers, False))
    assert playback.status == "cancelled"
    assert 0 < playback.steps <= 4 * STEPS_AT_ONCE  # both engines check in turn
    assert len(playback.frames) > 1
    playback = play(folded, replace(DEFAULT, controller="computed-torque", max_steps=100))
    assert (playback.status, playback.steps) == ("timeout", 100)
    assert "after 100 steps" in str(playback.reason)


def test_published_rule_folds_within_its_torque(folded: Folded) -> None:
    parameters = preset("paper")
    limited = replace(parameters.playback, motor_max_force=2000.0)
    playback = play(folded, limited)
    assert certify(
        folded.chain, folded.record, playback, replace(parameters, playback=limited)
    ).verified
    assert playback.rms_position_error < 1e-3
    assert playback.peak_torque <= 2000.0 * (1.0 + 1e-9)


def test_playback_without_record_or_controller_is_refused(folded: Folded) -> None:
    with refused("no-record", match="needs a record"):
        play_back(folded.chain, None, DEFAULT)
    with refused("unknown-controller", match="expected robot"):
        play(folded, replace(DEFAULT, controller="magic"))


def test_sink_and_progress(folded: Folded, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foldback.planner.playback.chain_run.PROGRESS_PERIOD_S", 0.0)
    parts: list[Motion] = []
    reports: list[Progress] = []
    playback = play(folded, DEFAULT, sink=parts.append, progress=reports.append, start_s=7.0)
    np.testing.assert_array_equal(Motion.joined(parts).time_s, playback.frames.time_s)
    assert playback.frames.time_s[0] == 7.0
    fractions = [p.fraction for p in reports]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < fractions[-1] <= 1.0
