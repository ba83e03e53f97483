from __future__ import annotations

import numpy as np
import pytest
import trimesh

from planner.chain.honeycomb import TETRAHEDRA_PER_RING
from planner.chain.module import TETRAHEDRON
from planner.chain.path import Path
from planner.errors import InputError
from planner.pathfinding.options import PathOptions
from planner.pipeline.prepare import Preparation, prepare
from planner.plan.shape_files import write_path

U = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0], [1, 2, 0], [0, 2, 0]]
VOXELS = b'{"format": "foldback-voxels/1", "cells": [[0,0,0],[1,0,0],[1,1,0],[5,5,5]]}'


def prepared(data: bytes, **options: object) -> Preparation:
    return prepare(data, "shape", PathOptions(module="tetrahedron", **options))  # pyright: ignore


def test_cells_of_a_path_become_rings() -> None:
    made = prepared(write_path(Path.from_cells(U, name="u")))
    assert made.kind == "voxels"
    assert len(made.chain) == TETRAHEDRA_PER_RING * len(U)
    assert made.chain.module is TETRAHEDRON
    assert made.knot.verdict == "unknot"
    # Each module is named by the cell in whose ring it lies: each cell twelve times.
    cells, counts = np.unique(made.cells, axis=0, return_counts=True)
    np.testing.assert_array_equal(cells, np.unique(U, axis=0))
    assert set(counts) == {TETRAHEDRA_PER_RING}


def test_chain_of_tetrahedra_begins_in_the_cell_asked_for() -> None:
    made = prepared(write_path(Path.from_cells(U)), start=(2, 1, 0), ends="surface")
    assert tuple(made.cells[0]) == (2, 1, 0)
    assert made.not_started == ""
    with pytest.raises(InputError) as refusal:
        prepared(write_path(Path.from_cells(U)), start=(7, 7, 7))
    assert refusal.value.code == "not-a-cell"
    with pytest.raises(InputError) as refusal:
        prepare(b"[[0,0,0],[1,0,0],[2,0,0]]", None, PathOptions(module="sphere"))
    assert refusal.value.code == "unknown-module"


def test_separate_parts_are_dropped_on_request_only() -> None:
    made = prepared(VOXELS)
    assert not made.chains
    assert [p.code for p in made.feasibility.problems] == ["disconnected"]
    with pytest.raises(InputError, match="2 parts"):
        _ = made.chain
    repaired = prepared(VOXELS, repair=True)
    assert len(repaired.chain) == 3 * TETRAHEDRA_PER_RING
    assert any("remove the other 1 cell" in note for note in repaired.notes)


@pytest.mark.slow
def test_mesh_is_filled_with_tetrahedra() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    data = mesh.export(file_type="stl")
    few, many = prepared(data, modules=72), prepared(data, modules=300)
    assert few.iou is not None
    assert many.iou is not None
    assert 0.3 < few.iou < many.iou < 1.0
    assert abs(len(many.chain) - 300) < 60
    report = many.report()
    assert report["module"] == "tetrahedron"
    assert len(report["positions"]) == len(report["wxyzs"]) == len(many.chain)
    assert len(report["line"]) == len(many.chain) + 1
    # The mesh lies where the chain does.
    vertices = np.array(report["mesh"]["vertices"])
    np.testing.assert_allclose(
        vertices.mean(axis=0), np.array(report["positions"]).mean(axis=0), atol=1.5
    )
    assert report["below"] % TETRAHEDRA_PER_RING == report["above"] % TETRAHEDRA_PER_RING == 0
