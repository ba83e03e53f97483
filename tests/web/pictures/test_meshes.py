"""Meshes of modules, of their drawn hull and of the table: closed and oriented outwards."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON, module_named
from foldback.planner.chain.module import Module, Piece
from foldback.planner.chain.polyhedron import Polyhedron
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD
from foldback.web.pictures.meshes import (
    DISPLAYED_MODULE_SIZE,
    piece_mesh,
    sketch_outline,
    stud_frames,
    stud_mesh,
)
from foldback.web.pictures.module_faces import DrawnFace, drawn_faces
from foldback.web.pictures.table_top import (
    MIN_TABLE_SIDE_PITCH,
    TABLE_MARGIN_PITCH,
    TableTop,
    disc_mesh,
)
from tests.planner.brackets import BRACKETS
from tests.planner.chains import chain_of

CHAIN = chain_of([(x, 0, 0) for x in range(12)] + [(11, 1, 0), (11, 1, 1)])
PRISM = module_named("snake-prism")
PIECES = [piece for module in (CUBE, TETRAHEDRON, PRISM, BRACKETS) for piece in module.pieces]
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
    for mesh in (piece_mesh(CUBE.pieces[0]), stud_mesh(), TABLE.mesh()):
        assert_closed(mesh.vertices, mesh.faces)
        assert volume(mesh.vertices, mesh.faces) > 0
    assert np.abs(piece_mesh(CUBE.pieces[0]).vertices).max() == pytest.approx(
        DISPLAYED_MODULE_SIZE / 2
    )


@pytest.mark.parametrize("piece", PIECES, ids=lambda piece: piece.name)
def test_faces_of_a_piece_close_to_its_mesh_and_bevels_turn_aside(piece: Piece) -> None:
    faces = drawn_faces(piece)
    assert len(faces) == sum(len(part.loops) for part in piece.parts)
    offsets = np.cumsum([0, *(len(face.vertices) for face in faces)])
    triangles = [face.triangles + at for face, at in zip(faces, offsets, strict=False)]
    corners = np.concatenate([face.vertices for face in faces])
    for part in piece.parts:  # parts touch: each is closed for itself
        middle = DISPLAYED_MODULE_SIZE * part.corners.mean(axis=0)
        own = [k for k, face in enumerate(faces) if _is_of(part, face)]
        assert_closed(corners, np.concatenate([triangles[k] for k in own]))
        assert all((faces[k].middle - middle) @ faces[k].normal > 0.0 for k in own)
    mesh = piece_mesh(piece)
    volumes = sum(volume(face.vertices, face.triangles) for face in faces)
    assert volumes == pytest.approx(volume(mesh.vertices, mesh.faces), rel=0.01)
    for face in faces:
        assert np.linalg.norm(face.normals, axis=1) == pytest.approx(1.0)
        on = face.vertices @ face.normal > face.middle @ face.normal - 1e-9
        assert face.normals[on] == pytest.approx(np.tile(face.normal, (on.sum(), 1)))
        assert (face.normals[~on] @ face.normal < 0.99).all()


def _is_of(part: Polyhedron, face: DrawnFace) -> bool:
    heights = DISPLAYED_MODULE_SIZE * part.corners @ face.normal
    return any(
        np.allclose(face.normal, normal)
        and np.allclose(face.middle, DISPLAYED_MODULE_SIZE * part.corners[list(loop)].mean(axis=0))
        for normal, loop in part.faces
    ) and heights.max() == pytest.approx(face.middle @ face.normal)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON, PRISM, BRACKETS], ids=lambda m: m.name)
def test_drawn_parts_are_closed_and_turn_outwards(module: Module) -> None:
    outline = sketch_outline(module, 2)
    assert outline["modules"] == 2
    assert outline["field_of_view_rad"] == pytest.approx(FIELD_OF_VIEW_RAD)
    parts = [part for piece in module.pieces for part in piece.parts]
    assert outline["pieces"][-1][1] == len(outline["parts"]) == len(parts)
    assert outline["pattern"] == list(module.pattern)
    for part, drawn in zip(parts, outline["parts"], strict=True):
        corners = np.array(drawn["corners"])
        np.testing.assert_allclose(corners, part.corners * DISPLAYED_MODULE_SIZE)
        for face, normal in zip(drawn["faces"], drawn["normals"], strict=True):
            ring = corners[face]
            turning = np.cross(ring[1] - ring[0], ring[2] - ring[1])
            np.testing.assert_allclose(turning / np.linalg.norm(turning), normal, atol=1e-9)
            np.testing.assert_allclose(ring @ normal, (corners @ normal).max(), atol=1e-9)
        assert_closed(corners, drawn["faces"])


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON, PRISM, BRACKETS], ids=lambda m: m.name)
def test_studs_lie_on_the_free_faces(module: Module) -> None:
    places, axes = stud_frames(module, 4)
    for piece, place, turn in zip((module.piece(0), module.piece(3)), places, axes, strict=True):
        heights = DISPLAYED_MODULE_SIZE * piece.corners @ turn[:, 0]
        assert place @ turn[:, 0] == pytest.approx(heights.max())
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert places[0] @ axes[0][:, 0] > 0.0
    if module is CUBE:
        assert places == pytest.approx(0.465 * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))


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
