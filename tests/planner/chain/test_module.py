from __future__ import annotations

import numpy as np
import pytest

from planner.chain.module import CUBE, MODULES, Module, module_named
from planner.errors import InputError


@pytest.mark.parametrize("module", MODULES.values(), ids=MODULES)
def test_geometry_of_modules(module: Module) -> None:
    for vectors in (module.axes, module.face_normals, module.edge_directions):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(module.turn @ module.turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(module.turn) == pytest.approx(1.0)
    np.testing.assert_allclose(module.vertices.mean(axis=0), 0.0, atol=1e-12)
    assert module.inner_radius <= module.radius
    assert 2.0 * module.inner_radius <= np.linalg.norm(module.anchor + module.offset) + 1e-12


def test_measures_of_a_cube() -> None:
    assert CUBE.radius == pytest.approx(np.sqrt(3.0) / 2.0)
    assert CUBE.inner_radius == pytest.approx(0.5)
    assert len(CUBE.vertices) == 8
    np.testing.assert_allclose(CUBE.inertia, 1.0 / 6.0)


def test_joint_names() -> None:
    assert len(CUBE.joint_names(160)) == 316
    assert len(CUBE.joint_names(2)) == 0
    assert CUBE.joint_names(4) == ("joint_1_z", "joint_1_y", "joint_2_z", "joint_2_y")


def test_unknown_module_is_refused() -> None:
    with pytest.raises(InputError, match="expected one of: .*cube") as refusal:
        module_named("sphere")
    assert refusal.value.code == "unknown-module"
