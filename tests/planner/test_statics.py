from __future__ import annotations

import mujoco
import numpy as np
import pytest

from planner.model import Material, tree_spec
from planner.statics import hinge_frames, static_torque
from tests.planner.chains import line, random_angles


@pytest.mark.parametrize("modules", [3, 4, 11, 12, 160])
def test_a_straight_chain_hangs_on_its_root(modules: int) -> None:
    # 1 + 2 + … of what lies beyond the root on its longer side.
    chain = line(modules)
    beyond = modules - 1 - chain.root
    before = chain.root - 1
    wanted = max(beyond * (beyond + 1) / 2, before * (before + 1) / 2)
    assert static_torque(chain, np.zeros_like(chain.folded_rad)) == pytest.approx(wanted)


@pytest.mark.parametrize("seed", range(5))
def test_no_direction_of_gravity_asks_for_more_in_mujoco(seed: int) -> None:
    chain = line(9)
    rng = np.random.default_rng(seed)
    angles = random_angles(chain, rng)
    spec = tree_spec(chain, Material(geom_size=0.1))
    model = spec.compile()
    data = mujoco.MjData(model)
    dofs = []
    for name, angle in zip(chain.joint_names, angles, strict=True):
        data.joint(name).qpos[0] = angle
        dofs.append(int(model.joint(name).dofadr[0]))
    worst = 0.0
    for _ in range(3000):
        down = rng.normal(size=3)
        model.opt.gravity[:] = down / np.linalg.norm(down)
        mujoco.mj_forward(model, data)
        worst = max(worst, float(np.abs(data.qfrc_bias[dofs]).max()))
    said = static_torque(chain, angles)
    assert worst <= said + 1e-9
    assert worst > 0.95 * said


def test_hinge_frames_are_mujocos() -> None:
    chain = line(7)
    angles = random_angles(chain, np.random.default_rng(1))
    model = tree_spec(chain, Material()).compile()
    data = mujoco.MjData(model)
    for name, angle in zip(chain.joint_names, angles, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    poses = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    axes, anchors = hinge_frames(chain, angles, poses)
    for k, name in enumerate(chain.joint_names):
        joint = model.joint(name).id
        # Before the root a hinge is drawn the other way round; its angle is the same.
        along = axes[k // 2, k % 2] @ data.xaxis[joint]
        assert abs(along) == pytest.approx(1.0)
        np.testing.assert_allclose(data.xanchor[joint], anchors[k // 2], atol=1e-12)
