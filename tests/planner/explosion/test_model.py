from __future__ import annotations

import mujoco
import pytest

from planner.chain.chain import Chain
from planner.simulation.model import Material, segment_spec, segment_starts, tree_spec
from tests.planner.chains import coil, line


def compiled_tree(chain: Chain, size: float = 0.9) -> mujoco.MjModel:
    return tree_spec(chain, Material(geom_size=size)).compile()


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
