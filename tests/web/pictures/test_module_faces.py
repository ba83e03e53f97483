from __future__ import annotations

import numpy as np
import pytest

from planner.chain.module import CUBE, TETRAHEDRON, Module
from web.pictures.meshes import DISPLAYED_MODULE_SIZE, module_mesh
from web.pictures.module_faces import Piece, module_faces


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def edges(piece: Piece) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    places = [tuple(np.round(v, 9) + 0.0) for v in piece.vertices]
    return [
        (places[t[i]], places[t[(i + 1) % 3]]) for t in piece.triangles.tolist() for i in range(3)
    ]


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON], ids=lambda m: m.name)
def test_pieces_close_to_the_mesh_of_the_module(module: Module) -> None:
    pieces = module_faces(module)
    assert len(pieces) == {"cube": 6, "tetrahedron": 4}[module.name]
    found = [edge for piece in pieces for edge in edges(piece)]
    assert sorted(found) == sorted((b, a) for a, b in found)
    whole = sum(volume(piece.vertices, piece.triangles) for piece in pieces)
    mesh = module_mesh(module)
    assert whole == pytest.approx(volume(mesh.vertices, mesh.faces), rel=0.01)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON], ids=lambda m: m.name)
def test_faces_are_flat_and_bevels_turn_towards_their_neighbours(module: Module) -> None:
    for piece in module_faces(module):
        assert np.linalg.norm(piece.normals, axis=1) == pytest.approx(1.0)
        on = piece.vertices @ piece.normal > piece.middle @ piece.normal - 1e-9
        assert piece.normals[on] == pytest.approx(np.tile(piece.normal, (on.sum(), 1)))
        assert (piece.normals[~on] @ piece.normal < 0.99).all()
        assert piece.middle @ piece.normal == pytest.approx(
            DISPLAYED_MODULE_SIZE * module.inner_radius
        )
