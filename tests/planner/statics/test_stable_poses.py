"""Stable poses of a rigid configuration on a floor."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.statics.balance import Balance
from foldback.planner.statics.stable_poses import resting_poses
from tests.planner.chains import chain_of, coil, line, random_angles, random_rotation


def test_resting_poses_of_a_rod() -> None:
    poses = line(5).folded_poses
    resting = list(resting_poses(line(5).module, poses.positions, poses.rotations))
    heights = [pose.shift[2] + (pose.turn @ poses.positions.mean(axis=0))[2] for pose in resting]
    assert heights == pytest.approx([0.5] * 4 + [2.5] * 2)
    assert [pose.margin for pose in resting] == pytest.approx([0.5] * 6)


@pytest.mark.parametrize("seed", range(4))
def test_resting_poses_stand_on_the_floor_and_balance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = coil(9) if seed % 2 else Chain.from_angles(TETRAHEDRON, np.zeros(6))
    angles = random_angles(chain, rng, 0.9)
    poses = forward_kinematics(chain.module, angles)
    turn = random_rotation(rng)
    positions, rotations = poses.positions @ turn.T + rng.normal(size=3), turn @ poses.rotations
    balance = Balance(chain)
    resting = list(resting_poses(chain.module, positions, rotations))
    assert resting
    for pose in resting:
        laid, turned = pose.of(positions, rotations)
        corners = chain.module.pieces[0].corners @ np.swapaxes(turned, 1, 2) + laid[:, None]
        assert corners[..., 2].min() == pytest.approx(0.0, abs=1e-9)
        assert np.allclose(turned @ np.swapaxes(turned, 1, 2), np.eye(3))
        assert np.linalg.norm(laid - laid[0]) == pytest.approx(
            np.linalg.norm(positions - positions[0])
        )
        assert laid.mean(axis=0)[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
        assert pose.margin >= 0.0
        assert balance.solve(laid, turned, angles).balances


def test_no_resting_pose_beside_the_centre_of_mass() -> None:
    # An L with a long arm rests on the arm, never on the foot alone.
    poses = chain_of([(0, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1), (3, 0, 1)]).folded_poses
    turns = [p.turn for p in resting_poses(line(3).module, poses.positions, poses.rotations)]
    down = [turn.T @ [0.0, 0.0, -1.0] for turn in turns]
    assert any(normal == pytest.approx([0.0, 0.0, 1.0]) for normal in down)
    assert not any(normal == pytest.approx([0.0, 0.0, -1.0]) for normal in down)
