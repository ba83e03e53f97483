from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path as FilePath
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain import Chain
from planner.folding import fold
from planner.paths import Path
from planner.plan import Plan
from planner.readers import read
from tests.planner.chains import coil, line
from tests.planner.conftest import SHAPES

Array = NDArray[np.float64]
SMALL = ("box-4x4x4", "mallet-24", "mallet-64", "mallet-80", "wrench-24", "wrench-80", "wrench-94")
LARGE = ("box-6x6x6", "mallet-160", "mallet-192", "wrench-160")


def test_every_shape_of_the_paper_is_folded_here() -> None:
    # Those of the gallery carry tags; `make bench` folds them.
    untagged = {
        path.stem for path in SHAPES.glob("*.json") if "tags" not in json.loads(path.read_bytes())
    }
    assert untagged == {*SMALL, *LARGE}


def configurations(plan: Plan) -> Iterator[tuple[Array, Array, Array]]:
    """All frames, and what lies halfway between them."""
    angles, places, turns = plan.joint_angles_rad, plan.root_position, plan.root_wxyz
    for k in range(len(angles)):
        yield angles[k], places[k], turns[k]
        if k + 1 < len(angles):
            near = turns[k + 1] * np.sign(turns[k] @ turns[k + 1])
            middle = turns[k] + near
            yield (
                0.5 * (angles[k] + angles[k + 1]),
                0.5 * (places[k] + places[k + 1]),
                middle / np.linalg.norm(middle),
            )


@pytest.mark.parametrize(
    "shape", [*SMALL, *(pytest.param(name, marks=pytest.mark.slow) for name in LARGE)]
)
def test_an_outsider_can_replay_the_fold(shape: str, folded: Callable[..., Any]) -> None:
    """Plain MuJoCo, the exported model, the exported plan: same poses, and nothing touches."""
    found = folded(shape)
    assert found.plan.certificate.verdict == "verified (simulated)"
    plan, chain = Plan.load(found.directory / "plan.json"), found.chain
    model = mujoco.MjModel.from_xml_path(str(found.directory / "model.xml"))
    data = mujoco.MjData(model)
    addresses = [int(model.joint(name).qposadr[0]) for name in chain.joint_names]
    sites = [model.site(f"module_{i}").id for i in range(len(chain))]
    root = int(model.joint("root").qposadr[0])
    difference, closest = 0.0, 0.0
    for angles, position, wxyz in configurations(plan):
        data.qpos[root : root + 3], data.qpos[root + 3 : root + 7] = position, wxyz
        data.qpos[addresses] = angles
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        poses = chain.poses(angles, position, wxyz)
        difference = max(difference, float(np.abs(data.site_xpos[sites] - poses.positions).max()))
        if data.ncon:
            closest = min(closest, float(data.contact.dist.min()))
    assert difference <= 1e-6
    assert closest >= -1e-9
    # The last configuration is the shape that was asked for.
    path = read((SHAPES / f"{shape}.json").read_bytes())
    assert isinstance(path, Path)
    poses = chain.poses(plan.joint_angles_rad[-1], plan.root_position[-1], plan.root_wxyz[-1])
    gaps = np.linalg.norm(poses.positions[:, None] - poses.positions[None], axis=2)
    wanted = np.linalg.norm(path.cells[:, None] - path.cells[None], axis=2)
    np.testing.assert_allclose(gaps, wanted, atol=1e-6)


@pytest.mark.parametrize("modules", [3, 4, 5, 7])
def test_the_smallest_chains_fold(modules: int) -> None:
    plan = fold(coil(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert plan.joint_angles_rad.shape[1] == 2 * (modules - 2)


@pytest.mark.parametrize("modules", [3, 10])
def test_a_line_has_nothing_to_fold(modules: int) -> None:
    plan = fold(line(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert np.abs(plan.joint_angles_rad).max() < 1e-6


def test_a_directory_is_made_and_filled(tmp_path: FilePath) -> None:
    plan = fold(coil(8), directory=tmp_path / "a" / "b", seed=5, module_size=0.9)
    assert plan.seed == 5
    assert plan.certificate.module_size == 0.9
    assert Plan.load(tmp_path / "a" / "b" / "plan.json").summary() == plan.summary()


def test_a_path_and_its_chain_fold_alike() -> None:
    path = Path.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)], name="same")
    one, other = fold(path), fold(Chain.from_path(path))
    np.testing.assert_allclose(one.joint_angles_rad, other.joint_angles_rad, atol=1e-9)
