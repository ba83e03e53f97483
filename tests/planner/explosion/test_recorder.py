import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.loop.recorder import FrameRule, Recorder, Step
from foldback.planner.motion.motion import Motion
from foldback.planner.simulation.reduced_state import State
from tests.planner.chains import line


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
    # The end of the chain moves by nearly twenty times the angle.
    centres = recording.motion().poses(chain).positions
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
