from __future__ import annotations

import mujoco
import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.simulation.model import Material, segment_spec, segment_starts, tree_spec
from tests.planner.chains import coil, line, random_angles, random_rotation

SIZES = (3, 17, 33)


def compiled_tree(chain: Chain, size: float = 0.9) -> mujoco.MjModel:
    return tree_spec(chain, Material(geom_size=size)).compile()


@pytest.mark.parametrize("modules", SIZES)
def test_modules_of_the_tree_are_where_kinematics_has_them(modules: int) -> None:
    chain = line(modules)
    model = compiled_tree(chain)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(modules)
    for _ in range(5):
        angles, rotation = random_angles(chain, rng), random_rotation(rng)
        position, wxyz = rng.normal(size=3), wxyz_from_matrix(rotation)
        data.joint("root").qpos[:] = [*position, *wxyz]
        for name, angle in zip(chain.joint_names, angles, strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        poses = chain.poses(angles, position, wxyz)
        for i in range(modules):
            body, site = data.body(f"module_{i}"), data.site(f"module_{i}")
            np.testing.assert_allclose(body.xpos, poses.positions[i], atol=1e-12)
            np.testing.assert_allclose(site.xpos, poses.positions[i], atol=1e-12)
            np.testing.assert_allclose(body.xmat, poses.rotations[i].ravel(), atol=1e-12)


@pytest.mark.parametrize("segmented", [False, True])
def test_only_consecutive_modules_are_exempt_from_contacts(segmented: bool) -> None:
    # At just over twice their size straight modules reach their second neighbours, no further ones.
    chain = line(12)
    material = Material(geom_size=2.1)
    spec = (
        segment_spec(chain, material, segment_starts(chain))
        if segmented
        else tree_spec(chain, material)
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    if segmented:
        for start in segment_starts(chain):
            data.joint(f"root_{start}").qpos[:3] = [start, 0.0, 0.0]
    else:
        data.joint("root").qpos[:3] = [chain.root, 0.0, 0.0]
    mujoco.mj_forward(model, data)
    touching = {
        tuple(sorted(int(model.geom(g).name.removeprefix("module_")) for g in contact.geom))
        for contact in data.contact
    }
    assert touching == {(i, i + 2) for i in range(10)}


def test_folded_chain_touches_nothing_below_full_size() -> None:
    chain = coil(24)
    for size, touches in ((0.99, False), (1.02, True)):
        model = compiled_tree(chain, size)
        data = mujoco.MjData(model)
        for name, angle in zip(chain.joint_names, chain.folded_rad, strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_forward(model, data)
        assert bool(data.ncon) is touches
