from __future__ import annotations

import numpy as np
import pytest

from planner.chain.module import CUBE
from web.pictures.meshes import DISPLAYED_MODULE_SIZE, MODULE_BEVEL, Mesh, module_mesh, stud_mesh


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("mesh", [module_mesh(CUBE), stud_mesh()], ids=["cube", "stud"])
def test_meshes_are_closed_and_turn_outwards(mesh: Mesh) -> None:
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    assert len({tuple(e) for e in edges}) == len(edges)
    assert {tuple(e) for e in edges} == {tuple(e[::-1]) for e in edges}
    assert volume(mesh) > 0


def test_cube_leaves_a_gap_and_loses_its_edges() -> None:
    mesh = module_mesh(CUBE)
    assert np.abs(mesh.vertices).max() == pytest.approx(DISPLAYED_MODULE_SIZE / 2)
    assert len(mesh.vertices) == 24  # four for each face
    # Each edge loses a prism with legs of the bevel, each corner a bit more.
    side = DISPLAYED_MODULE_SIZE
    assert (
        side**3 - 12 * side * MODULE_BEVEL**2 / 2
        <= volume(mesh)
        < side**3 - 11 * 0.8 * MODULE_BEVEL**2 / 2
    )


def test_every_corner_of_the_hull_is_cut() -> None:
    mesh = module_mesh(CUBE)
    nearest = np.linalg.norm(
        mesh.vertices[None] - DISPLAYED_MODULE_SIZE * CUBE.vertices[:, None], axis=-1
    ).min(axis=1)
    assert nearest == pytest.approx(MODULE_BEVEL * np.sqrt(2))
