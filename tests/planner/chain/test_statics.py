from __future__ import annotations

import mujoco
import numpy as np
import pytest

from planner.chain.statics import static_torque
from planner.simulation.model import Material, tree_spec
from tests.planner.chains import line, random_angles


@pytest.mark.parametrize("modules", [3, 12])
def test_torque_of_a_straight_chain(modules: int) -> None:
    # 1 + 2 + … of what lies beyond the root on its longer side.
    chain = line(modules)
    beyond = modules - 1 - chain.root
    before = chain.root - 1
    wanted = max(beyond * (beyond + 1) / 2, before * (before + 1) / 2)
    assert static_torque(chain, np.zeros_like(chain.folded_rad)) == pytest.approx(wanted)


@pytest.mark.parametrize("modules", [5, 14])
def test_torque_in_the_worst_direction_agrees_with_mujoco(modules: int) -> None:
    # Torques are linear in gravity: three directions tell all.
    chain = line(modules)
    rng = np.random.default_rng(modules)
    model = tree_spec(chain, Material(geom_size=0.1)).compile()
    data = mujoco.MjData(model)
    dofs = [int(model.joint(name).dofadr[0]) for name in chain.joint_names]
    for _ in range(60):
        angles = random_angles(chain, rng)
        for name, angle in zip(chain.joint_names, angles, strict=True):
            data.joint(name).qpos[0] = angle
        torques = np.empty((3, len(dofs)))
        for axis in range(3):
            model.opt.gravity[:] = np.eye(3)[axis]
            mujoco.mj_forward(model, data)
            torques[axis] = data.qfrc_bias[dofs]
        worst = float(np.linalg.norm(torques, axis=0).max())
        assert static_torque(chain, angles) == pytest.approx(worst, rel=1e-9)
