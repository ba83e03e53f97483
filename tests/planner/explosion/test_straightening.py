from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.explosion.straightening import straightening
from planner.motion.motion import Motion
from planner.simulation.reduced import State
from tests.planner.chains import coil, line, random_state


def straightened(chain: Chain, state: State) -> Motion | None:
    return straightening(
        chain, state, start_s=5.0, snapshot_rad=0.02, snapshot_distance=0.5, size=0.95
    )


def gentle(chain: Chain, seed: int) -> State:
    state = random_state(chain, seed, most=0.1)
    state.angles[1::2] = 0.0
    return state


@pytest.mark.parametrize("modules", [3, 10, 40])
def test_straightening_ends_straight_in_small_steps(modules: int) -> None:
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
