from __future__ import annotations

import json
from pathlib import Path as FilePath

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.pipeline.fold import fold
from planner.plan.plan import Plan
from tests.planner.chains import coil, line
from tests.planner.conftest import SHAPES

Array = NDArray[np.float64]
PAPER = {
    *("box-4x4x4", "box-6x6x6"),
    *("mallet-24", "mallet-64", "mallet-80", "mallet-160", "mallet-192"),
    *("wrench-24", "wrench-80", "wrench-94", "wrench-160"),
}


def test_every_shape_of_the_paper_is_folded_here() -> None:
    # Those of the gallery carry tags. `make test-long` folds and replays all.
    untagged = {
        path.stem for path in SHAPES.glob("*.json") if "tags" not in json.loads(path.read_bytes())
    }
    assert untagged == PAPER


@pytest.mark.parametrize(
    "modules", [3, 7, *(pytest.param(n, marks=pytest.mark.long) for n in (4, 5))]
)
def test_the_smallest_chains_fold(modules: int) -> None:
    plan = fold(coil(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert plan.joint_angles_rad.shape[1] == 2 * (modules - 2)


@pytest.mark.parametrize("modules", [pytest.param(3, marks=pytest.mark.long), 10])
def test_a_line_has_nothing_to_fold(modules: int) -> None:
    plan = fold(line(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert np.abs(plan.joint_angles_rad).max() < 1e-6


def test_a_directory_is_made_and_filled(tmp_path: FilePath) -> None:
    plan = fold(coil(8), directory=tmp_path / "a" / "b", seed=5, module_size=0.9)
    assert plan.seed == 5
    assert plan.certificate.module_size == 0.9
    assert Plan.load(tmp_path / "a" / "b" / "plan.json").summary() == plan.summary()


@pytest.mark.slow
def test_a_path_and_its_chain_fold_alike() -> None:
    path = Path.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)], name="same")
    one, other = fold(path), fold(Chain.from_path(path))
    np.testing.assert_allclose(one.joint_angles_rad, other.joint_angles_rad, atol=1e-9)
