from __future__ import annotations

import mujoco
import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.simulation.model import Material, segment_spec, segment_starts, tree_spec
from tests.planner.chains import coil, line, random_angles, random_rotation

SIZES = (3, 4, 5, 9, 16, 17, 18, 33)


def compiled_tree(chain: Chain, size: float = 0.9) -> mujoco.MjModel:
    return tree_spec(chain, Material(geom_size=size)).compile()


@pytest.mark.parametrize("modules", SIZES)
def test_the_tree_puts_the_modules_where_kinematics_does(modules: int) -> None:
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


@pytest.mark.parametrize("modules", SIZES)
def test_each_module_weighs_one_and_there_is_no_gravity(modules: int) -> None:
    model = compiled_tree(line(modules))
    assert model.body_mass.sum() == pytest.approx(modules)
    np.testing.assert_array_equal(model.opt.gravity, 0.0)
    assert model.nv == 6 + 2 * (modules - 2)


@pytest.mark.parametrize("modules", SIZES)
def test_segments_weigh_the_same_with_every_hinge_once(modules: int) -> None:
    chain = line(modules)
    starts = segment_starts(chain)
    assert starts[0] == 0
    assert chain.root in starts
    model = segment_spec(chain, Material(), starts).compile()
    assert model.body_mass.sum() == pytest.approx(modules)
    assert model.neq == len(starts) - 1
    assert model.nv == 6 * len(starts) + len(chain.folded_rad)
    assert {model.joint(i).name for i in range(model.njnt)} == {
        *chain.joint_names,
        *(f"root_{start}" for start in starts),
    }


@pytest.mark.parametrize("segmented", [False, True])
def test_only_consecutive_modules_are_exempt_from_contact(segmented: bool) -> None:
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


def test_a_folded_chain_touches_nothing_below_full_size() -> None:
    chain = coil(24)
    for size, touches in ((0.99, False), (1.02, True)):
        model = compiled_tree(chain, size)
        data = mujoco.MjData(model)
        for name, angle in zip(chain.joint_names, chain.folded_rad, strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_forward(model, data)
        assert bool(data.ncon) is touches


def test_what_the_material_says_is_in_the_model() -> None:
    material = Material(stiffness=3.0, armature=10.0, damping=0.5, friction=0.2, geom_size=0.8)
    model = tree_spec(line(5), material).compile()
    hinges = [model.joint(name) for name in line(5).joint_names]
    assert {float(h.stiffness[0]) for h in hinges} == {3.0}
    assert {float(h.armature[0]) for h in hinges} == {10.0}
    assert {float(h.damping[0]) for h in hinges} == {0.5}
    for hinge in hinges:
        np.testing.assert_allclose(hinge.range, np.deg2rad([-92.0, 92.0]))
    np.testing.assert_allclose(model.geom_size, 0.4)
    np.testing.assert_allclose(model.geom_friction[:, 0], 0.2)
    np.testing.assert_array_equal(model.geom_condim, 3)
