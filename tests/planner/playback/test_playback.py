from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.certificate.certificate import certify
from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.chain.rotations import aligned_distances
from planner.errors import InputError
from planner.motion.angle_steps import PLAN_STEP_RAD
from planner.motion.inverse import inverse_dynamics
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.parameters.parameters import Parameters, preset
from planner.parameters.playback import PlaybackParameters, RobotParameters
from planner.playback.playback import Playback, play_back
from planner.progress import Progress
from planner.simulation.tree import Tree
from tests.planner.conftest import REAL

Array = NDArray[np.float64]

DEFAULT = PlaybackParameters()
IDEAL = PlaybackParameters(controller="computed-torque")


@pytest.fixture(scope="module")
def small(folded: Callable[..., Any]) -> tuple[Chain, Record]:
    fold = folded("wrench-24")
    return fold.chain, fold.record


@pytest.mark.parametrize("shape", REAL)
def test_robots_fold_real_shapes(
    shape: str, folded: Callable[..., Any], tmp_path: FilePath
) -> None:
    fold = folded(shape)
    playback, record = fold.playback, fold.record
    assert playback.status == "folded"
    assert playback.rms_position_error <= 1e-3
    assert playback.max_angle_error_rad <= 2e-3
    frames = playback.frames
    last = frames.joint_angles_rad[-1]
    ends = fold.chain.poses(last, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    distances = aligned_distances(ends.positions, fold.chain.folded_poses.positions)
    assert np.sqrt((distances**2).mean()) == pytest.approx(playback.rms_position_error, abs=1e-12)
    assert set(frames.phase.tolist()) == {1}
    assert (np.diff(frames.time_s) > 0).all()
    np.testing.assert_allclose(
        frames.joint_error_rad,
        np.abs(playback.reference_rad - frames.joint_angles_rad),
        # The target's angles are rounded to whole steps when they become the plan's.
        atol=0.5 * PLAN_STEP_RAD + 1e-15,
    )
    assert frames.joint_error_rad.max() <= playback.max_angle_error_rad + 1e-15
    # It starts where the record has left the chain, at rest.
    np.testing.assert_array_equal(frames.joint_angles_rad[0], 0.0)
    np.testing.assert_array_equal(frames.root_position[0], record.frames.root_position[-1])
    np.testing.assert_allclose(frames.root_wxyz[0], record.frames.root_wxyz[-1], atol=1e-12)
    assert frames.time_s[0] == record.frames.time_s[-1]
    playback.save(tmp_path / "playback.npz")
    again = Playback.load(tmp_path / "playback.npz")
    assert again.summary() == playback.summary()
    np.testing.assert_array_equal(again.reference_rad, playback.reference_rad)
    np.testing.assert_array_equal(again.frames.joint_error_rad, frames.joint_error_rad)


def test_floating_chain_folds_about_its_centre_of_mass(small: tuple[Chain, Record]) -> None:
    chain, record = small
    # That of equal modules; those of a robot are not quite equal.
    frames = play_back(chain, record, IDEAL).frames
    poses = chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz)
    centres = poses.positions.mean(axis=1)
    assert np.linalg.norm(centres - centres[0], axis=1).max() < 0.05


def test_weak_motors_miss_the_target(small: tuple[Chain, Record]) -> None:
    chain, record = small
    weak = replace(DEFAULT, robot=RobotParameters(torque_limit=0.3))
    playback = play_back(chain, record, weak)
    assert playback.status == "missed"
    assert "a robot lost its target: joint_" in playback.reason
    assert playback.rms_position_error > 0.1
    ideal = play_back(chain, record, IDEAL)
    assert playback.peak_torque <= 0.31 * ideal.peak_torque
    certificate = certify(chain, record, playback, Parameters())
    assert not certificate.verified


def test_unstable_controller_diverges(small: tuple[Chain, Record]) -> None:
    chain, record = small
    playback = play_back(chain, record, replace(IDEAL, bandwidth=1e6))
    assert playback.status == "diverged"
    assert np.isfinite(playback.frames.joint_angles_rad).all()
    assert np.isfinite(playback.rms_position_error)
    assert not certify(chain, record, playback, Parameters()).verified


def test_torques_that_are_not_finite_end_the_playback(
    small: tuple[Chain, Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Tree.apply_torques
    calls = 0

    def broken(self: Tree, torques: Array) -> None:
        nonlocal calls
        calls += 1
        original(self, torques * np.nan if calls > 100 else torques)

    monkeypatch.setattr(Tree, "apply_torques", broken)
    playback = play_back(*small, IDEAL)
    assert playback.status == "diverged"
    assert "finite" in playback.reason
    assert playback.steps == 100
    assert len(playback.frames) > 3
    for name in ("joint_angles_rad", "root_position", "root_wxyz", "joint_error_rad"):
        assert np.isfinite(getattr(playback.frames, name)).all()
    assert np.isfinite(playback.rms_position_error)
    assert playback.rms_position_error > 0.1
    assert np.isfinite(playback.peak_torque)


def test_cancelled_or_too_long_playback_keeps_its_frames(small: tuple[Chain, Record]) -> None:
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked == 4

    playback = play_back(*small, DEFAULT, cancelled=cancelled)
    assert playback.status == "cancelled"
    assert 0 < playback.steps <= 100  # several robots are asked in turn
    assert len(playback.frames) > 1
    playback = play_back(*small, replace(DEFAULT, max_steps=100))
    assert (playback.status, playback.steps) == ("timeout", 100)
    assert "after 100 steps" in playback.reason


@pytest.mark.slow
@pytest.mark.long
def test_direct_servoing_of_a_real_shape_fails(folded: Callable[..., Any]) -> None:
    # All hinges at once lead the chain through itself.
    fold = folded("mallet-64", "direct")
    assert fold.plan.certificate.verdict.startswith("failed: in the plan, modules")
    assert fold.plan.certificate.min_clearance < -0.5
    limited = replace(preset("direct").playback, torque_limit=1000.0)
    playback = play_back(fold.chain, None, limited)
    assert playback.status == "missed"
    assert "pitches (RMS) from its target" in playback.reason
    assert playback.rms_position_error > 0.3


def test_direct_servoing_folds_small_shapes() -> None:
    for cells in (
        [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (0, 1, 0)],
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)],
    ):
        chain = Chain.from_path(Path.from_cells(cells))
        parameters = preset("direct")
        playback = play_back(chain, None, parameters.playback)
        assert playback.status == "folded", cells
        assert certify(chain, None, playback, parameters).verified, cells


@pytest.mark.parametrize("torque_limit", [None, 2000.0])
def test_published_rule_folds(small: tuple[Chain, Record], torque_limit: float | None) -> None:
    parameters = preset("paper")
    parameters = replace(
        parameters, playback=replace(parameters.playback, torque_limit=torque_limit)
    )
    playback = play_back(*small, parameters.playback)
    assert certify(*small, playback, parameters).verified
    assert playback.rms_position_error < 1e-3
    assert torque_limit is None or playback.peak_torque <= torque_limit * (1.0 + 1e-9)


def test_playback_without_record_or_controller_is_refused(small: tuple[Chain, Record]) -> None:
    chain, record = small
    with pytest.raises(InputError, match="needs a record") as refused:
        play_back(chain, None, DEFAULT)
    assert refused.value.code == "no-record"
    with pytest.raises(InputError, match="expected robot") as refused:
        play_back(chain, record, replace(DEFAULT, controller="magic"))
    assert refused.value.code == "unknown-controller"


def test_sink_and_progress(small: tuple[Chain, Record], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.playback.run.PROGRESS_PERIOD_S", 0.0)
    parts: list[Motion] = []
    told: list[Progress] = []
    playback = play_back(*small, DEFAULT, sink=parts.append, progress=told.append, start_s=7.0)
    np.testing.assert_array_equal(Motion.joined(parts).time_s, playback.frames.time_s)
    assert playback.frames.time_s[0] == 7.0
    fractions = [p.fraction for p in told]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < fractions[-1] <= 1.0


def test_long_chain_is_played_back_by_kinematics(
    small: tuple[Chain, Record], tmp_path: FilePath
) -> None:
    chain, record = small
    seen: list[Motion] = []
    playback = play_back(
        chain, record, replace(DEFAULT, dynamic_up_to=len(chain) - 1), sink=seen.append, start_s=3.0
    )
    assert playback.kind == "kinematic"
    frames = playback.frames
    torques = inverse_dynamics(chain, frames)
    assert len(torques.frames) == len(frames) - 2
    assert (playback.peak_torque, playback.rms_torque) == (torques.peak, torques.rms)
    assert frames.time_s[0] == 3.0
    assert (np.diff(frames.time_s) > 0.0).all()
    assert (frames.joint_angles_rad[0] == 0.0).all()
    assert frames.joint_angles_rad[-1] == pytest.approx(chain.folded_rad, abs=1e-12)
    # Nothing was simulated, so there is no error to show, and nothing pushes the chain away.
    assert np.isnan(frames.joint_error_rad).all()
    centres = chain.poses(
        frames.joint_angles_rad, frames.root_position, frames.root_wxyz
    ).positions.mean(axis=1)
    assert np.abs(centres - centres[0]).max() < 1e-9
    assert np.array_equal(Motion.joined(seen).joint_angles_rad, frames.joint_angles_rad)
    certificate = certify(chain, record, playback, Parameters())
    assert certificate.verdict == "verified (kinematics only)"
    assert certificate.peak_torque_nm is not None and certificate.peak_torque_nm > 0.0
    playback.save(tmp_path / "playback.npz")
    again = Playback.load(tmp_path / "playback.npz")
    assert (again.kind, again.peak_torque) == ("kinematic", torques.peak)
