"""Meshes of many lines: read the same as line by line, and refused without much memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import trimesh

from planner.errors import InputError
from planner.readers import read
from planner.shapes.seams import is_surface
from planner.shapes.solid import Solid, signed_volume
from tests.planner.solids_made import box

PLAIN = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n"
ODD = {
    "slashes": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1/2 2//3 3/1/1\nf 1 3/7 4\n",
    "counted back": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0.5\nf -4 -2 -1\n",
    "tabs and indents": b"\tv\t0 0 0\n  v 1 0 0\nv 1 1 0\r\nv 0 1 0.5\n f 1 2 3 \nf\t1 3 4",
    "other lines": b"# f 1 1 1\nvn 0 0 1\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\ng v\nv 0 1 5e-1\n"
    b"usemtl x\nf 1 2 3\ns off\nf 1 3 4\n",
    "a remark": b"v 0 0 0 # here\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n",
    "a quad": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3 4\n",
    "continued": b"v 0 0 0\nv 1 \\\n0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 \\\n3\nf 1 3 4\n",
}


@pytest.fixture
def triangles(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, np.ndarray]]:
    """What readers make solids of; they themselves are left out."""
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def keep(vertices: np.ndarray, faces: np.ndarray, **more: object) -> None:
        seen.append((np.asarray(vertices), np.asarray(faces)))

    monkeypatch.setattr(Solid, "from_triangles", keep)
    return seen


@pytest.mark.parametrize("kind", ODD)
def test_lines_of_obj_mean_the_same_however_they_are_written(kind: str, triangles: list) -> None:
    read(ODD[kind], filename="a.obj")
    read(PLAIN, filename="b.obj")
    (points, faces), (plain, plain_faces) = triangles
    np.testing.assert_array_equal(points, plain)
    first = np.argmin(faces, axis=1)[:, None]  # a triangle may begin at any of its corners
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    np.testing.assert_array_equal(turned, plain_faces)


def test_the_line_at_fault_is_named() -> None:
    data = PLAIN * 20 + b"f 1 2 x\n" + PLAIN
    with pytest.raises(InputError) as refused:
        read(data, filename="a.obj")
    assert refused.value.where == "line 121"


TEXT_STL = b"solid a vertex\n" + b"".join(
    b"facet normal 0 0 0\nOUTER LOOP\n%sendloop\nendfacet\n"
    % b"".join(b"vertex %d %d %d\n" % corner for corner in corners)
    for corners in (
        ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    )
)


@pytest.mark.parametrize("end", [b"endsolid a vertex\n", b"endsolid"])
@pytest.mark.parametrize("between", [b"\n", b"\r\n", b" "])
def test_the_ways_in_which_stl_is_written_as_text(between: bytes, end: bytes) -> None:
    solid = read((TEXT_STL + end).replace(b"\n", between), filename="a.stl")
    assert isinstance(solid, Solid)
    assert signed_volume(solid.vertices, solid.faces) == pytest.approx(1 / 6)


SOUPS = {
    "apart": lambda rng, n: (rng.random((3 * n, 3)), np.arange(3 * n).reshape(-1, 3)),
    "over few points": lambda rng, n: (rng.random((1000, 3)), rng.integers(0, 1000, (n, 3))),
    "over many points": lambda rng, n: (rng.random((n, 3)), rng.integers(0, n, (n, 3))),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SOUPS)
def test_triangles_at_random_are_no_surface(kind: str) -> None:
    points, faces = SOUPS[kind](np.random.default_rng(0), 600_000)
    with pytest.raises(InputError) as refused:
        Solid.from_triangles(points, faces)
    assert refused.value.code == "not-a-surface"


def test_surfaces_are_surfaces_sewn_or_not() -> None:
    mesh = trimesh.creation.torus(2.0, 0.8, major_sections=400, minor_sections=300)
    assert is_surface(mesh.vertices, mesh.faces)
    loose = np.asarray(mesh.triangles).reshape(-1, 3)
    assert is_surface(loose, np.arange(len(loose)).reshape(-1, 3))
    assert is_surface(mesh.vertices, mesh.faces[: len(mesh.faces) * 9 // 10])
    small = box(1.0, 2.0, 3.0)
    assert is_surface(small.vertices, small.faces)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["same.obj", "same.off", "same.stl"])
def test_a_million_lines_of_nothing_are_refused_in_little_memory(name: str) -> None:
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    facet = b"facet\nouter loop\n" + 3 * b"vertex 0 0 0\n" + b"endloop\nendfacet\n"
    data = {
        "same.obj": corners + b"f 1 1 1\n" * 1_000_000,
        "same.off": b"OFF 3 1000000 0\n" + corners.replace(b"v ", b"") + b"3 0 0 0\n" * 1_000_000,
        "same.stl": b"solid\n" + facet * 200_000 + b"endsolid\n",
    }[name]
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as refused:
            read(data, filename=name)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert refused.value.code == "degenerate"
    assert peak < 450e6
