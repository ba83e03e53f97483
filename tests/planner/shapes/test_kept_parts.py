"""What cells keep of a mesh: separate bodies, holes through it, and larger numbers of modules."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare, prepare_in_any_order
from foldback.planner.shapes.tunnels import tunnels_of_cells, tunnels_of_samples, tunnels_of_surface
from foldback.planner.shapes.voxelise import voxelise
from tests.planner.solids_made import Mesh, box, exported, solid_of, torus

BODY_CELLS = 20


def boxes(*parts: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Mesh:
    """Return boxes as one mesh, each given by its sides and its lowest corner."""
    built_meshes: list[Mesh] = []
    for sides, corner in parts:
        built_meshes.append(box(*sides))
        built_meshes[-1].apply_translation(np.array(corner) + np.array(sides) / 2)
    mesh = trimesh.util.concatenate(built_meshes)
    assert isinstance(mesh, Mesh)
    return mesh


def cup() -> Mesh:
    """Return a block with a thin handle."""
    bars = (((1.2, 0.4, 0.4), (1.9, 0.8, z)) for z in (0.2, 1.4))
    return boxes(((2, 2, 2), (0, 0, 0)), *bars, ((0.4, 0.4, 1.6), (2.7, 0.8, 0.2)))


@pytest.mark.parametrize(
    ("mesh", "shares"),
    [
        (boxes(((2, 2, 2), (0, 0, 0)), ((2, 2, 2), (2, 2, 0))), (0.5,)),
        (
            boxes(((2, 2, 2), (0, 0, 0)), ((2, 2, 1), (9, 0, 0)), ((2, 1, 1), (0, 9, 0))),
            (2 / 7, 1 / 7),
        ),
        (boxes(((4, 4, 4), (0, 0, 0)), ((0.5, 0.8, 0.8), (9, 0, 0))), (0.005 / 1.005,)),
        (boxes(((4, 4, 4), (0, 0, 0)), ((0.01, 0.01, 0.01), (9, 0, 0))), (1e-6 / 64,)),
    ],
    ids=["edge to edge", "4 to 2 to 1", "half a percent", "a speck below the samples"],
)
def test_separate_bodies_are_reported_with_exact_shares(
    mesh: Mesh, shares: tuple[float, ...]
) -> None:
    voxels = voxelise(solid_of(mesh), cells=BODY_CELLS)
    assert voxels.unused == pytest.approx(shares, rel=1e-6)
    text = {0.5: "50 %", 2 / 7: "29 % and 14 %"}.get(shares[0], "left out")
    assert "separate bodies" in voxels.notes[0]
    assert text in voxels.notes[0]
    assert voxels.iou <= 1.0 - sum(shares)
    assert voxels.retention.volume <= 1.0 - sum(shares)


def test_bodies_that_overlap_or_lie_in_cavities_are_not_separate() -> None:
    hollow = boxes(((4, 4, 4), (0, 0, 0)), ((2, 2, 2), (1, 1, 1)))
    assert voxelise(solid_of(hollow), cells=BODY_CELLS).unused == ()
    crossing = boxes(((4, 4, 4), (0, 0, 0)), ((4, 4, 4), (3, 3, 3)))
    assert voxelise(solid_of(crossing), cells=BODY_CELLS).unused == ()


def test_similarity_of_two_bodies_never_exceeds_the_share_of_the_used_one() -> None:
    alone, both_parts = (
        prepare(exported("stl", mesh), "a.stl", PathOptions(modules=64, method="blocks")).report(
            full=False
        )
        for mesh in (
            boxes(((3, 3, 3), (0, 0, 0))),
            boxes(((3, 3, 3), (0, 0, 0)), ((2, 3, 3), (9, 0, 0))),
        )
    )
    assert alone["iou"] == pytest.approx(1.0)
    assert both_parts["iou"] == pytest.approx(0.6, abs=0.002)
    assert both_parts["unused_bodies"] == pytest.approx([0.4])
    assert both_parts["cells"] == alone["cells"]


def test_a_fitted_path_joins_separate_bodies_where_it_pays() -> None:
    near, far = (
        prepare(
            exported("stl", boxes(((3, 3, 3), (0, 0, 0)), ((2, 3, 3), (x, 0, 0)))),
            "a.stl",
            PathOptions(modules=32),
        )
        for x in (4, 40)
    )
    assert near.method == "fitted" and near.likeness is not None
    assert near.likeness.iou > 0.65  # the larger body alone has at most 0.6
    report = near.report(full=False)
    assert report["unused_bodies"] == [] and near.voxels is not None and near.voxels.joined
    assert "2 separate bodies; modules in the air" in near.notes[0]
    assert far.report(full=False)["unused_bodies"] == pytest.approx([0.4])


def test_lost_handle_is_reported_with_the_numbers_of_modules_for_a_likeness() -> None:
    mesh = exported("stl", cup())
    blocks = PathOptions(method="blocks", modules=96)
    report = prepare_in_any_order(mesh, "cup.stl", blocks).report(full=False)
    assert report["tunnels"] == {"mesh": 1, "cells": 0}
    assert report["keeps_parts"] is False
    assert any("1 hole through it" in note for note in report["notes"])
    assert all(note[0] == note[0].upper() for note in report["notes"])
    assert [offer["likeness"] for offer in report["reach"]] == [0.6, 0.75, 0.9]
    enough = report["reach"][2]["modules"]
    likeness = prepare(mesh, "cup.stl", PathOptions(method="blocks", modules=enough)).likeness
    assert likeness is not None
    assert likeness.iou > 0.87
    # A fitted path keeps the handle with as many modules as blocks that lose it.
    fitted = prepare(mesh, "cup.stl", PathOptions(modules=96)).report(full=False)
    assert (fitted["method"], fitted["tunnels"]) == ("fitted", {"mesh": 1, "cells": 1})


@pytest.mark.long
def test_exact_fits_need_few_modules() -> None:
    cube = exported("stl", box(4, 4, 4))
    report = prepare_in_any_order(cube, "a.stl", PathOptions(modules=8)).report(full=False)
    assert report["keeps_parts"] is True
    assert [offer["modules"] for offer in report["reach"]] == [8, 8, 8]
    for offer in ({"module": "tetrahedron"}, {"world": "table"}):
        options = PathOptions(modules=8, **offer)  # type: ignore[arg-type]
        assert prepare_in_any_order(cube, "a.stl", options).reach == {}


def test_snake_is_possible_only_for_boxes() -> None:
    cube, ring = (
        prepare(exported("stl", mesh), "a.stl", PathOptions(modules=32, method="blocks")).report(
            full=False
        )
        for mesh in (box(4, 4, 2), torus())
    )
    assert "snake" in cube["possible_methods"]
    assert ring["possible_methods"] == ["auto", "blocks", "fitted", "exact"]


def test_volume_note_adds_up_to_what_is_missing() -> None:
    sheet = boxes(((10, 10, 0.2), (0, 0, 0)), ((0.2, 0.2, 6), (0, 0, 0)), ((10, 0.2, 8), (0, 0, 0)))
    voxels = voxelise(solid_of(sheet), cells=BODY_CELLS)
    note = next(note for note in voxels.notes if "outside of the cells" in note)
    shares = [int(word) for word in note.split() if word.isdigit()]
    assert sum(shares) == 100 - round(100 * voxels.retention.volume)


def ring_cells() -> NDArray[np.bool_]:
    cells = np.ones((5, 5, 3), dtype=bool)
    cells[1:-1, 1:-1] = False
    return cells


def test_tunnels_of_rings_cavities_and_crossing_holes() -> None:
    block = np.ones((5, 5, 5), dtype=bool)
    assert tunnels_of_cells(block) == 0
    hollow = block.copy()
    hollow[2, 2, 2] = False
    assert tunnels_of_cells(hollow) == 0
    assert tunnels_of_cells(ring_cells()) == 1
    crossed = block.copy()
    crossed[2, 2, :] = crossed[2, :, 2] = False
    assert tunnels_of_cells(crossed) == 3
    assert tunnels_of_samples(np.kron(crossed, np.ones((2, 2, 2), dtype=bool))) == 3


def test_tunnels_are_undecided_where_samples_only_touch_at_edges() -> None:
    ring = np.zeros((6, 6, 3), dtype=bool)
    ring[1:5, 1:5] = True
    ring[2:4, 2:4] = False
    ring[1, 1] = False  # its neighbours, (1, 2) and (2, 1), then only share an edge
    assert tunnels_of_cells(ring) == 0
    assert tunnels_of_samples(ring) is None


def test_tunnels_of_surfaces() -> None:
    assert tunnels_of_surface(np.asarray(torus().faces)) == 1
    assert tunnels_of_surface(np.asarray(box(1, 1, 1).faces)) == 0
    edge_to_edge = solid_of(boxes(((2, 2, 2), (0, 0, 0)), ((2, 2, 2), (2, 2, 0))))
    assert tunnels_of_surface(edge_to_edge.faces) is None
