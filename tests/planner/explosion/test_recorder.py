from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.explosion.recorder import FrameRule, Recorder, Step
from planner.explosion.straightening import straightening
from planner.motion.motion import Motion
from planner.simulation.reduced import State
from tests.planner.chains import coil, line, random_state


def step_of(chain: Chain, time_s: float, angle: float) -> Step:
    angles = np.zeros(len(chain.folded_rad))
    angles[chain.joint_names.index(f"joint_{chain.root}_z")] = angle
    state = State.at_rest(angles, np.zeros(3), np.eye(3))
    poses = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return Step.of(time_s, state, poses.positions)


def recorder(chain: Chain, parts: list[Motion], *, distance: float = 100.0) -> Recorder[Step]:
    rule = FrameRule(chain=chain, snapshot_rad=0.1, snapshot_distance=distance, size=0.9)
    return Recorder(rule, parts.append)


def test_snapshots_are_as_sparse_as_allowed() -> None:
    chain, parts = line(6), []
    recording = recorder(chain, parts)
    for k in range(100):
        recording.add(step_of(chain, 0.1 * k, 0.03 * k))
        if k % 10 == 0:
            recording.commit()
    recording.commit(end=True)
    frames = recording.motion()
    steps = np.diff(frames.joint_angles_rad.max(axis=1))
    assert steps.max() < 0.1 + 1e-12
    assert steps[:-1].min() > 0.05
    assert frames.joint_angles_rad[0].max() == 0.0
    assert frames.joint_angles_rad[-1].max() == 0.03 * 99
    assert (np.diff(frames.time_s) > 0).all()


def test_far_moves_of_a_module_make_snapshots() -> None:
    chain, parts = line(40), []
    recording = recorder(chain, parts, distance=0.5)
    for k in range(11):
        recording.add(step_of(chain, k, 0.009 * k))
    recording.commit(end=True)
    # The end of the chain swings by nearly twenty times the angle.
    centres = chain.poses(
        recording.motion().joint_angles_rad, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    ).positions
    moved = np.linalg.norm(np.diff(centres, axis=0), axis=2).max(axis=1)
    assert len(recording) > 3
    assert moved.max() <= 0.5


def test_steps_taken_back_are_not_recorded() -> None:
    chain, parts = line(6), []
    recording = recorder(chain, parts)
    recording.add(step_of(chain, 0.0, 0.0))
    recording.commit()
    recording.add(step_of(chain, 1.0, 2.0))
    recording.take_back()
    recording.add(step_of(chain, 1.0, 0.5))
    recording.commit(end=True)
    np.testing.assert_array_equal(recording.motion().joint_angles_rad.max(axis=1), [0.0, 0.5])


def test_sink_gets_every_snapshot_once_and_in_order() -> None:
    chain, parts = line(6), []
    recording = recorder(chain, parts)
    for k in range(50):
        recording.add(step_of(chain, k, 0.07 * k))
        recording.commit()
    recording.commit(end=True)
    passed_on = Motion.joined(parts)
    np.testing.assert_array_equal(passed_on.time_s, recording.motion().time_s)
    assert len(passed_on) == len(recording)
    assert np.isnan(passed_on.joint_error_rad).all()


def straightened(chain: Chain, state: State) -> Motion | None:
    return straightening(
        chain, state, start_s=5.0, snapshot_rad=0.02, snapshot_distance=0.5, size=0.95
    )


def gentle(chain: Chain, seed: int) -> State:
    state = random_state(chain, seed, most=0.1)
    state.angles[1::2] = 0.0
    return state


def test_straightening_ends_straight_in_small_steps() -> None:
    modules = 40
    chain = line(modules)
    chain = line(modules)
    state = gentle(chain, modules)
    frames = straightened(chain, state)
    np.testing.assert_array_equal(frames.joint_angles_rad[-1], 0.0)
    way = np.concatenate([state.angles[None], frames.joint_angles_rad])
    assert np.abs(np.diff(way, axis=0)).max() <= 0.02 + 1e-12
    roots = np.concatenate([state.position[None], frames.root_position])
    wxyz = wxyz_from_matrix(state.rotation)
    poses = chain.poses(way, roots, np.broadcast_to(wxyz, (len(way), 4)))
    moved = np.linalg.norm(np.diff(poses.positions, axis=0), axis=2)
    assert moved.max() <= 0.5
    # The centre of mass stays.
    centres = poses.positions.mean(axis=1)
    np.testing.assert_allclose(centres, np.broadcast_to(centres[0], centres.shape), atol=1e-12)
    assert frames.time_s[0] > 5.0
    assert (np.diff(frames.time_s) > 0).all()


def test_folded_chain_is_not_straightened() -> None:
    chain = coil(16)
    folded = chain.folded_poses
    state = State.at_rest(
        chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
    )
    assert straightened(chain, state) is None
