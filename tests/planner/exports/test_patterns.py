"""Models of chains whose pieces and joints differ from module to module."""

import numpy as np
import pytest

from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.exports.mjcf_pieces import coordinates, pieces, starts_of
from foldback.planner.simulation.lazy_mujoco import mujoco
from tests.planner.brackets import BRACKETS
from tests.planner.chains import random_angles, random_rotation, unvalidated


def test_trees_of_a_long_chain_have_the_joints_and_masses_of_its_pieces() -> None:
    chain = unvalidated(BRACKETS, np.zeros(79))
    rng = np.random.default_rng(1)
    angles, turn = random_angles(chain, rng), random_rotation(rng)
    model = mujoco.MjModel.from_xml_string(pieces(chain, module_size=0.9) + "</mujoco>")
    data = mujoco.MjData(model)
    position, wxyz = np.array([1.0, -2.0, 0.5]), wxyz_from_matrix(turn)
    data.qpos[:] = coordinates(chain, angles, position, wxyz)
    mujoco.mj_kinematics(model, data)
    poses = chain.poses(angles, position, wxyz)
    assert len(starts_of(chain)) == 2
    for i in range(len(chain)):
        site = data.site(f"module_{i}")
        np.testing.assert_allclose(site.xpos, poses.positions[i], atol=1e-9)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), poses.rotations[i], atol=1e-9)
    for name, (low, high) in zip(chain.joint_names, chain.ranges_rad, strict=True):
        assert model.joint(name).range.tolist() == [low, high]
    assert model.body_mass.sum() == pytest.approx(chain.module.masses(len(chain)).sum())
