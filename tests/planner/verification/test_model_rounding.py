"""Replays of modules whose measures have more digits than MuJoCo writes into model files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.exports.mjcf import mjcf
from foldback.planner.motion.motion import Motion
from foldback.planner.verification.replay import replay, replay_differs
from tests.planner.conftest import Folded


def test_models_of_prisms_have_the_poses_of_the_plan(folded: Folded) -> None:
    angles = np.deg2rad([0.0, 0.0, 90.0, 0.0, 0.0, -90.0, 0.0, 0.0, 90.0, 0.0, 0.0])
    chain = Chain.from_angles(module_named("snake-prism"), angles)
    poses = chain.folded_poses
    motion = Motion.from_frames(
        time_s=np.array([0.0, 1.0]),
        phase="playback",
        joint_angles_rad=np.stack([angles, 0.9 * angles]),
        root_position=np.tile(poses.positions[chain.root], (2, 1)),
        root_wxyz=np.tile(poses.wxyzs[chain.root], (2, 1)),
    )
    plan = replace(folded.plan, chain=chain, motion=motion)
    result = replay(plan, mjcf(chain, module_size=0.9))
    assert result.pose_difference < 1e-9
    assert list(replay_differs(result)) == []
    wrong = replace(result, pose_difference=1e-5)
    (difference,) = replay_differs(wrong)
    assert "poses differ" in difference
