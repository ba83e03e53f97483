"""Meshes of many lines: read the same as line by line, and refused without much memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import trimesh

from planner.errors import InputError
from planner.readers import off, read, stl
from planner.shapes.mesh_repair import is_surface
from planner.shapes.solid import Solid
from tests.case import case
from tests.planner.solids_made import box

PLAIN = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n"


@pytest.fixture
def triangles(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, np.ndarray]]:
    """What readers make solids of; they themselves are left out."""
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def keep(vertices: np.ndarray, faces: np.ndarray, **more: object) -> None:
        seen.append((np.asarray(vertices), np.asarray(faces)))

    monkeypatch.setattr(Solid, "from_triangles", keep)
    return seen


def test_off_lines_are_read_alike_at_once_and_one_by_one(
    triangles: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    data = mesh.export(file_type="off").encode()
    read(data, filename="ball.off")
    monkeypatch.setattr(off, "_many", lambda *arguments: None)
    read(data, filename="ball.off")
    (points, faces), (slow_points, slow_faces) = triangles
    assert len(faces) == len(mesh.faces)
    np.testing.assert_array_equal(points, slow_points)
    np.testing.assert_array_equal(faces, slow_faces)


SAME_STL = {
    "as it is": lambda text: text,
    "in capitals": bytes.upper,
    "with exponents": lambda text: text.replace(b"vertex 0.0 ", b"Vertex 0.0E+00 "),
    "on one line": lambda text: b" ".join(text.split()),
    "with a word a line": lambda text: b"\n".join(text.split()),
    "with other line ends": lambda text: text.replace(b"\n", b"\r\n"),
    "called after its words": lambda text: text.replace(b"solid", b"solid vertex facet", 1),
    "as two solids": lambda text: text.replace(b"endfacet", b"endfacet\nendsolid x\nsolid", 1),
    "with normals that are none": lambda text: text.replace(b"normal 0", b"normal -nan(ind)"),
}


@pytest.mark.parametrize("part", [1, 4000, 1 << 20])
def test_variants_of_stl_text_are_read_alike(
    part: int, triangles: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stl, "PART_BYTES", part)
    mesh = trimesh.creation.icosphere(subdivisions=1)
    text = mesh.export(file_type="stl_ascii").encode()
    for way, written in SAME_STL.items():
        read(written(text), filename="ball.stl")
        points, faces = triangles.pop()
        with case(way):
            np.testing.assert_array_equal(points[faces], mesh.triangles)


def test_faulty_line_of_an_obj_is_named() -> None:
    data = PLAIN * 20 + b"f 1 2 x\n" + PLAIN
    with pytest.raises(InputError) as refused:
        read(data, filename="a.obj")
    assert refused.value.where == "line 121"


def test_sewn_and_loose_meshes_are_surfaces() -> None:
    mesh = trimesh.creation.torus(2.0, 0.8, major_sections=200, minor_sections=100)
    assert is_surface(mesh.vertices, mesh.faces)
    loose = np.asarray(mesh.triangles).reshape(-1, 3)
    assert is_surface(loose, np.arange(len(loose)).reshape(-1, 3))
    assert is_surface(mesh.vertices, mesh.faces[: len(mesh.faces) * 9 // 10])
    small = box(1.0, 2.0, 3.0)
    assert is_surface(small.vertices, small.faces)


def test_random_triangles_are_no_surface() -> None:
    rng, count = np.random.default_rng(0), 100_000
    for points in (300, count):
        assert not is_surface(rng.random((points, 3)), rng.integers(0, points, (count, 3)))
    with pytest.raises(InputError) as refused:
        Solid.from_triangles(rng.random((3 * count, 3)), np.arange(3 * count).reshape(-1, 3))
    assert refused.value.code == "not-a-surface"


@pytest.mark.slow
def test_many_degenerate_triangles_are_refused_in_little_memory() -> None:
    data = b"OFF 3 400000 0\n0 0 0\n1 0 0\n0 1 0\n" + b"3 0 0 0\n" * 400_000
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as refused:
            read(data, filename="same.off")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert refused.value.code == "degenerate"
    assert peak < 100e6
