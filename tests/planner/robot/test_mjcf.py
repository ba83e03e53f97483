from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.exports.mjcf import mjcf
from planner.readers import read
from tests.planner.conftest import SHAPES


def loaded(chain: Chain, size: float = 0.95) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(mjcf(chain, module_size=size))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("shape", ["wrench-24", "mallet-64", "wrench-160", "mallet-192"])
def test_the_keys_are_the_folded_and_the_straight_chain(shape: str) -> None:
    chain = Chain.from_path(read((SHAPES / f"{shape}.json").read_bytes()))
    model, data = loaded(chain)
    folded = chain.folded_poses
    for name, angles, root in (
        ("folded", chain.folded_rad, folded.positions[chain.root]),
        ("straight", np.zeros_like(chain.folded_rad), folded.positions.mean(axis=0)),
    ):
        mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
        mujoco.mj_forward(model, data)
        wxyz = wxyz_from_matrix(folded.rotations[chain.root])
        poses = chain.poses(angles, root, wxyz)
        for i in range(len(chain)):
            site = data.site(f"module_{i}")
            np.testing.assert_allclose(site.xpos, poses.positions[i], atol=1e-9)
            np.testing.assert_allclose(site.xmat, poses.rotations[i].ravel(), atol=1e-9)
        assert data.ncon == 0
        np.testing.assert_array_equal(model.key(name).qpos[:3], root)


def test_there_are_as_many_keys_sites_and_joints_as_promised() -> None:
    chain = Chain.from_path(read((SHAPES / "wrench-24.json").read_bytes()))
    model, _ = loaded(chain)
    assert model.nkey == 2
    assert model.nsite == len(chain)
    assert {model.joint(i).name for i in range(model.njnt)} == {"root", *chain.joint_names}
    np.testing.assert_allclose(model.geom_size, 0.475)


def test_a_plan_replayed_in_plain_mujoco_gives_the_same_poses(folded: Callable[..., Any]) -> None:
    fold = folded("mallet-64")
    plan, chain = fold.plan, fold.chain
    model = mujoco.MjModel.from_xml_path(str(fold.directory / "model.xml"))
    data = mujoco.MjData(model)
    for k in range(0, len(plan.time_s), 10):
        data.joint("root").qpos[:] = [*plan.root_position[k], *plan.root_wxyz[k]]
        for name, angle in zip(chain.joint_names, plan.joint_angles_rad[k], strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        poses = chain.poses(plan.joint_angles_rad[k], plan.root_position[k], plan.root_wxyz[k])
        places = np.array([data.site(f"module_{i}").xpos for i in range(len(chain))])
        np.testing.assert_allclose(places, poses.positions, atol=1e-9)
