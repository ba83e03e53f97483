"""Meshes of modules, of their drawn hull and of the table: closed and oriented outwards."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.module import Module
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD
from foldback.web.pictures.meshes import (
    DISPLAYED_MODULE_SIZE,
    module_mesh,
    sketch_outline,
    stud_mesh,
)
from foldback.web.pictures.module_faces import module_faces
from foldback.web.pictures.table_top import (
    MIN_TABLE_SIDE_PITCH,
    TABLE_MARGIN_PITCH,
    TableTop,
    disc_mesh,
)
from tests.planner.chains import chain_of

CHAIN = chain_of([(x, 0, 0) for x in range(12)] + [(11, 1, 0), (11, 1, 1)])
TABLE = TableTop.under(CHAIN, CHAIN.folded_poses.positions)


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def assert_closed(vertices: np.ndarray, rings: np.ndarray | list[list[int]]) -> None:
    """Check that the faces pass every edge once in each direction."""
    places = [tuple(np.round(vertex, 6) + 0.0) for vertex in vertices]
    edges = [
        (places[a], places[b])
        for ring in rings
        for a, b in zip(ring, np.roll(ring, -1), strict=True)
    ]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)


def test_meshes_are_closed_and_turn_outwards() -> None:
    for mesh in (module_mesh(CUBE), stud_mesh(), TABLE.mesh()):
        assert_closed(mesh.vertices, mesh.faces)
        assert volume(mesh.vertices, mesh.faces) > 0
    assert np.abs(module_mesh(CUBE).vertices).max() == pytest.approx(DISPLAYED_MODULE_SIZE / 2)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON])
def test_faces_of_a_module_close_to_its_mesh_and_bevels_turn_aside(module: Module) -> None:
    pieces = module_faces(module)
    assert len(pieces) == {"cube": 6, "tetrahedron": 4}[module.name]
    offsets = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    triangles = [p.triangles + at for p, at in zip(pieces, offsets, strict=False)]
    assert_closed(np.concatenate([p.vertices for p in pieces]), np.concatenate(triangles))
    mesh = module_mesh(module)
    volumes = sum(volume(piece.vertices, piece.triangles) for piece in pieces)
    assert volumes == pytest.approx(volume(mesh.vertices, mesh.faces), rel=0.01)
    for piece in pieces:
        assert np.linalg.norm(piece.normals, axis=1) == pytest.approx(1.0)
        on = piece.vertices @ piece.normal > piece.middle @ piece.normal - 1e-9
        assert piece.normals[on] == pytest.approx(np.tile(piece.normal, (on.sum(), 1)))
        assert (piece.normals[~on] @ piece.normal < 0.99).all()
        height = DISPLAYED_MODULE_SIZE * module.inner_radius
        assert piece.middle @ piece.normal == pytest.approx(height)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON])
def test_drawn_hull_is_closed_and_turns_outwards(module: Module) -> None:
    outline = sketch_outline(module, 2)
    assert outline["modules"] == 2
    assert outline["field_of_view_rad"] == pytest.approx(FIELD_OF_VIEW_RAD)
    corners = np.array(outline["corners"])
    np.testing.assert_allclose(corners, module.vertices * DISPLAYED_MODULE_SIZE)
    for face, normal in zip(outline["faces"], outline["normals"], strict=True):
        ring = corners[face]
        turning = np.cross(ring[1] - ring[0], ring[2] - ring[1])
        np.testing.assert_allclose(turning / np.linalg.norm(turning), normal, atol=1e-9)
        np.testing.assert_allclose(ring @ normal, (corners @ normal).max(), atol=1e-9)
    assert_closed(corners, outline["faces"])


def test_table_is_below_all_modules_and_larger_than_the_motion() -> None:
    table = TableTop.under(CHAIN, np.array([[[-3.0, 2.0, 0.0], [20.0, 4.0, 1.0]]]))
    assert (table.height, table.middle) == (pytest.approx(-0.5), (8.5, 3.0))
    assert table.sides == (23.0 + 1.0 + 2 * TABLE_MARGIN_PITCH, MIN_TABLE_SIDE_PITCH)
    assert min(TableTop.under(CHAIN).sides) > 2 * len(CHAIN)  # for an unknown motion
    mesh = TABLE.mesh()
    full = TABLE.thickness * TABLE.sides[0] * TABLE.sides[1]
    assert 0.85 * full < volume(mesh.vertices, mesh.faces) < full
    disc = disc_mesh()
    a, b, c = (disc.vertices[disc.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
