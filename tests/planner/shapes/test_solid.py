import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import MAX_VERTEX_COORDINATE, Solid, signed_volume
from foldback.planner.shapes.solid_sampling import sample
from tests.case import case
from tests.planner.solids_made import box, solid_of, torus
from tests.refusal import refused

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


ROTATED = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
RNG = np.random.default_rng(0)


def test_vertices_that_almost_meet_are_sewn_together() -> None:
    mesh = torus()
    noise = np.random.default_rng(0).normal(scale=1e-8, size=(3 * len(mesh.faces), 3))
    corners = np.round(mesh.triangles.reshape(-1, 3) + noise, 12)
    solid = Solid.from_triangles(corners, np.arange(len(corners)).reshape(-1, 3))
    assert any("merged" in note for note in solid.notes)
    assert signed_volume(solid.vertices, solid.faces) == pytest.approx(mesh.volume, rel=1e-3)


@pytest.mark.parametrize("missing", [1, 7])
def test_holes_are_closed(missing: int) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    solid = Solid.from_triangles(mesh.vertices, mesh.faces[missing:])
    assert solid.oriented
    assert any("open" in note and "closed" in note for note in solid.notes)
    volume = signed_volume(solid.vertices, solid.faces)
    assert volume == pytest.approx(mesh.volume, rel=0.02)


def test_triangles_are_turned_outwards() -> None:
    faces = FACES.copy()
    faces[2] = faces[2, ::-1]
    for turned, note in (
        (faces, "1 triangle was flipped to match neighbouring triangles."),
        (FACES[:, ::-1], "inside out"),
    ):
        solid = Solid.from_triangles(TETRAHEDRON, turned)
        assert (solid.closed, solid.oriented) == (True, True)
        assert signed_volume(solid.vertices, solid.faces) == pytest.approx(1 / 6)
        assert len(solid.notes) == 1 and note in solid.notes[0]


CUBES = {
    "in a cavity": ([(6, 0), (4, 0), (2, 0)], 160.0, 160.0),
    "touching along an edge": ([(2, 0), (2, (2, 2, 0))], 16.0, 16.0),
    "touching at a corner": ([(2, 0), (2, (2, 2, 2))], 16.0, 16.0),
    "with a common wall": ([(2, 0), (2, (2, 0, 0))], 16.0, 16.0),
    "overlapping": ([(2, 0), (2, (1, 1, 1))], 16.0, 15.0),
    "apart": ([(2, 0), (2, (5, 0, 0)), (2, (0, 5, 0))], 24.0, 24.0),
    "a cavity at the wall": ([(6, 0), (2, (2, 0, 0))], 208.0, 208.0),
}
"""Cubes, each with its side and its centre; the signed and the sampled volume."""


@pytest.mark.parametrize("kind", CUBES)
def test_solid_of_several_bodies_orients_each_by_itself(kind: str) -> None:
    cubes, volume, sampled = CUBES[kind]
    for inverted in range(2 ** len(cubes)):
        meshes = []
        for k, (side, middle) in enumerate(cubes):
            meshes.append(box(side, side, side))
            meshes[-1].apply_translation(np.zeros(3) + middle)
            if inverted >> k & 1:
                meshes[-1].invert()
        solid = solid_of(trimesh.util.concatenate(meshes))
        assert signed_volume(solid.vertices, solid.faces) == pytest.approx(volume)
        inside = sample(solid, pitch=0.5, size=2, rotation=np.eye(3))
        assert inside.volume == pytest.approx(sampled)
        assert inverted == 0 or solid.notes or kind in ("in a cavity", "a cavity at the wall")


def test_triangles_without_area_are_left_out() -> None:
    faces = np.vstack([FACES, [[0, 0, 1], [2, 2, 2]]])
    solid = Solid.from_triangles(TETRAHEDRON, faces)
    assert len(solid) == 4
    assert solid.oriented
    assert "2 triangles" in solid.notes[0]
    # Vertices that no triangle uses are removed, even invalid ones.
    solid = Solid.from_triangles([*TETRAHEDRON, [np.nan] * 3, [1e300] * 3], FACES)
    assert len(solid.vertices) == 4


def test_meshes_without_volume_or_surface_are_refused() -> None:
    for vertices, faces, code in (
        (TETRAHEDRON, np.zeros((0, 3)), "no-triangles"),
        (TETRAHEDRON, FACES + 1, "bad-index"),
        (np.where(TETRAHEDRON > 0, np.nan, 0), FACES, "not-finite"),
        (TETRAHEDRON * 2 * MAX_VERTEX_COORDINATE, FACES, "too-far"),
        ((TETRAHEDRON * [1, 1, 0]) @ ROTATED.T, FACES, "flat"),
        # Coincident walls, a triangle soup, and points only.
        (TETRAHEDRON, [[0, 1, 2], [0, 2, 1], [0, 1, 3], [0, 3, 1]], "no-volume"),
        (RNG.random((300, 3)), np.arange(300).reshape(-1, 3), "not-a-surface"),
        (TETRAHEDRON, np.tile(RNG.integers(0, 4, (1_000_000, 1)), 3), "degenerate"),
    ):
        with case(code), refused(code):
            Solid.from_triangles(vertices, faces)
    with refused("too-many-triangles"):
        Solid.from_triangles(TETRAHEDRON, FACES, max_triangles=3)


def test_regular_or_long_meshes_are_not_flat() -> None:
    # Every eighth vertex of this one lies in one plane.
    rows = trimesh.creation.torus(2.0, 0.7, major_sections=1000, minor_sections=8)
    assert solid_of(rows).oriented
    assert solid_of(box(1000, 1, 0.5)).oriented


COORDINATES = st.integers(-1000, 1000)
CELLS = st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=1, max_size=40)


def test_invalid_cells_and_pitch_are_refused() -> None:
    with refused("empty"):
        Shape.from_cells(np.zeros((0, 3)))
    with refused("not-whole", "cell 1"):
        Shape.from_cells([[0, 0, 0], [0, 0.5, 0]])
    with refused("bad-pitch"):
        Shape.from_cells([[0, 0, 0]], pitch_m=0.0)


@given(CELLS, st.randoms(use_true_random=False))
def test_shape_has_its_cells_in_one_order(cells: list[tuple[int, ...]], rng) -> None:  # type: ignore[no-untyped-def]
    shape = Shape.from_cells(cells)
    assert shape.cells.tolist() == sorted([list(c) for c in set(cells)])
    shuffled = [*cells, cells[0]]
    rng.shuffle(shuffled)
    np.testing.assert_array_equal(Shape.from_cells(shuffled).cells, shape.cells)
    assert len(shape) == len(set(cells))
