import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pathfinding.shape_overlap import likeness_of
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.shapes.inside_points import inside_points
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.verification.verify import verify
from tests.case import case
from tests.planner.folds import run_fold
from tests.planner.solids_made import Mesh, box, exported, solid_of
from tests.planner.verification.test_verify import edit_plan, findings

Cells = NDArray[np.int64]


def block(*sides: int) -> Cells:
    return np.argwhere(np.ones(sides, dtype=bool))


def centred_box(*sides: float, at: tuple[float, float, float]) -> Mesh:
    mesh = box(*sides)
    mesh.apply_translation(at)
    return mesh


def test_likeness_is_within_a_hundredth_of_the_exact_value() -> None:
    brick = centred_box(4, 3, 2, at=(2, 1.5, 1))
    tube = trimesh.creation.annulus(1.9, 2.0, 4.0, sections=256)  # 4.9 in volume
    eighth = 4.9 / 8
    for name, mesh, cells, expected in (
        ("same", brick, block(4, 3, 2), (1.0, 0.0, 0.0)),
        ("half", brick, block(2, 3, 2), (0.5, 0.5, 0.0)),
        ("twice", brick, block(8, 3, 2), (0.5, 0.0, 0.5)),
        ("shifted", centred_box(2, 2, 2, at=(2, 1, 1)), block(2, 2, 2), (1 / 3, 0.5, 0.5)),
        ("long", centred_box(1, 1, 150, at=(0.5, 0.5, 75)), block(1, 1, 75), (0.5, 0.5, 0.0)),
        ("thin", tube, block(2, 2, 2), (eighth / (4.9 + 8 - eighth), 7 / 8, 1 - eighth / 8)),
    ):
        with case(name):
            placed = inside_points(solid_of(mesh)).moved(np.eye(3), 1.0, -0.5)
            likeness = likeness_of(placed, cells)
            assert (likeness.iou, likeness.missing, likeness.added) == pytest.approx(
                expected, abs=0.01
            )


def test_likeness_does_not_depend_on_how_the_solid_lies() -> None:
    ball = trimesh.creation.icosphere(3, 1.5)
    cells = block(3, 3, 3) - 1
    places: list[NDArray[np.float64]] = [np.eye(4)]
    for angle in (0.4, 2.0):
        places.append(np.asarray(trimesh.transformations.rotation_matrix(angle, (1, 2, 3))))
    ious: list[float] = []
    for place in places:
        turned = ball.copy()
        turned.apply_transform(place)
        placed = inside_points(solid_of(turned)).moved(place[:3, :3].T, 1.0, 0.0)
        ious.append(likeness_of(placed, cells).iou)
    assert ious == pytest.approx([ball.volume / 27] * len(places), abs=0.003)


def voxels(cells: Any) -> bytes:
    return json.dumps(np.asarray(cells).tolist()).encode()


def test_likeness_of_voxels_counts_their_repair() -> None:
    block_of_8 = block(2, 2, 2)
    loose = np.concatenate([block_of_8, [[5, 5, 5], [6, 5, 5]]])
    cases: tuple[tuple[str, Cells, dict[str, Any], Likeness], ...] = (
        ("as given", block_of_8, {}, Likeness(iou=1.0, missing=0.0, added=0.0)),
        ("in eighths", block_of_8, {"method": "blocks"}, Likeness(iou=1.0, missing=0.0, added=0.0)),
        ("repaired", loose, {"repair": True}, Likeness(iou=0.8, missing=0.2, added=0.0)),
        (
            "turned on a table",
            np.argwhere(np.ones((1, 2, 5), dtype=bool)),
            {"world": "table"},
            Likeness(iou=1.0, missing=0.0, added=0.0),
        ),
    )
    for name, cells, changed, expected in cases:
        with case(name):
            options = PathOptions(as_voxels=True, **changed)
            assert prepare(voxels(cells), "a.json", options).likeness == expected


@pytest.mark.long
def test_plan_states_the_likeness_that_verification_measures_again(tmp_path: FilePath) -> None:
    mesh = exported("stl", centred_box(2, 2, 2.6, at=(0, 0, 0)))
    place = tmp_path / "fold"
    plan = run_fold(place, mesh, filename="box.stl", modules=8, method="blocks")
    measured = prepare(mesh, "box.stl", PathOptions(modules=8, method="blocks")).likeness
    assert measured is not None
    assert 0.6 < measured.iou < 0.9
    assert plan.likeness == measured
    assert plan.summary()["likeness"] == measured.as_dict()
    assert verify(place).problems == ()
    edit_plan(place, lambda values: values["likeness"].update(iou=0.95))
    assert "likeness, measured again from input.iou: got 0.95, expected 0.7" in findings(place)
    edit_plan(place, lambda values: values.update(likeness=None))
    assert "likeness, measured again from input: got null, expected {" in findings(place)
