import numpy as np
import pytest

from foldback.planner.chain.honeycomb import tetrahedra_at
from foldback.planner.pathfinding.shape_overlap import TETRAHEDRON_PLANES, regions_of
from foldback.planner.shapes.uncovered_surface import DEPTH_PITCH, ModuleRegions, uncovered_surface
from tests.planner.solids_made import box, torus


def area(triangles: np.ndarray) -> float:
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return float(0.5 * np.linalg.norm(sides, axis=1).sum())


def test_surface_without_modules_behind_it_is_cut_along_their_faces() -> None:
    bar = box(6, 2, 2)  # modules fill the half with x < 0.5
    cells = np.array([[x, y, z] for x in (-3, -2, -1, 0) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    vertices, faces = np.asarray(bar.vertices), np.asarray(bar.faces)
    for oriented in (True, False):
        missing = uncovered_surface(vertices, faces, regions_of(cells), oriented=oriented)
        assert area(missing) == pytest.approx(2.5 * 8 + 4)  # its sides and one end
        assert missing[..., 0].min() == pytest.approx(0.5, abs=0.02)
    everywhere = ModuleRegions(
        is_covered=lambda points: points[:, 0] < 9, normals=np.eye(3), offset=0.5
    )
    assert not len(uncovered_surface(vertices, faces, everywhere, oriented=True))


def test_pieces_between_tetrahedra_lie_in_one_each() -> None:
    ring = torus()
    nowhere = ModuleRegions(
        is_covered=lambda points: np.zeros(len(points), dtype=np.bool_),
        normals=TETRAHEDRON_PLANES,
        offset=0.0,
    )
    vertices, faces = np.asarray(ring.vertices), np.asarray(ring.faces)
    pieces = uncovered_surface(vertices, faces, nowhere, oriented=True)
    assert area(pieces) == pytest.approx(ring.area, rel=1e-6)
    assert len(pieces) > 2 * len(faces)
    normals = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    below = pieces - (DEPTH_PITCH + 0.01) * normals[:, None]
    inner = 0.98 * below + 0.02 * below.mean(axis=1, keepdims=True)
    places = tetrahedra_at(inner.reshape(-1, 3)).reshape(-1, 3, 3)
    assert (places == places[:, :1]).all()
