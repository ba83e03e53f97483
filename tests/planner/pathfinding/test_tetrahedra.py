"""Chains of tetrahedra, from their angles to a verified plan, by the same code as for cubes."""

from itertools import product

import numpy as np
import pytest
import trimesh

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import TETRAHEDRA_PER_RING
from foldback.planner.chain.path import Path
from foldback.planner.clearance.margins import largest_size
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pathfinding.trail_search import find_trails
from foldback.planner.pipeline.prepare import Preparation, prepare
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.readers.angle_strings import read_angle_string
from foldback.planner.shapes.shape import Shape
from tests.refusal import refused

RING = "- - - + - - - + - - -"


def cube(side: int) -> Chain:
    cells = np.array(list(product(range(side), repeat=3)))
    return Chain.from_trail(find_trails(Shape.from_cells(cells)).trails[0])


def test_largest_size_without_a_collision() -> None:
    chain = read_angle_string(RING)
    # From straight halfway to folded, at constant rates: the closest moment is the end.
    motion = np.linspace(0.0, 1.0, 40)[:, None] * chain.folded_rad[None]
    partly = motion[:24]
    size = largest_size(chain, (partly,), clear_at=0.5)
    assert sweep(chain, partly, module_size=size).clearance >= 0.0
    assert size == 1.0 or sweep(chain, partly, module_size=min(1.0, size + 0.03)).bound <= 0.0


U = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0], [1, 2, 0], [0, 2, 0]]
VOXELS = b'{"format": "foldback-voxels/1", "cells": [[0,0,0],[1,0,0],[1,1,0],[5,5,5]]}'


def prepare_chain(data: bytes, **options: object) -> Preparation:
    return prepare(data, "shape", PathOptions(module="tetrahedron", **options))  # pyright: ignore


def test_cells_of_a_path_become_rings() -> None:
    preparation = prepare_chain(write_path(Path.from_cells(U, name="u")))
    assert preparation.kind == "voxels"
    assert len(preparation.chain) == TETRAHEDRA_PER_RING * len(U)
    assert preparation.chain.module is TETRAHEDRON
    assert preparation.knot.verdict == "unknot"
    # Each module is labelled with the cell in whose ring it lies: each cell occurs twelve times.
    cells, counts = np.unique(preparation.cells, axis=0, return_counts=True)
    np.testing.assert_array_equal(cells, np.unique(U, axis=0))
    assert set(counts) == {TETRAHEDRA_PER_RING}


def test_chain_of_tetrahedra_starts_in_the_requested_cell() -> None:
    preparation = prepare_chain(write_path(Path.from_cells(U)), start=(2, 1, 0), ends="surface")
    assert tuple(preparation.cells[0]) == (2, 1, 0)
    assert preparation.not_started == ()
    with refused("not-a-cell"):
        prepare_chain(write_path(Path.from_cells(U)), start=(7, 7, 7))


def test_separate_parts_are_dropped_on_request_only() -> None:
    preparation = prepare_chain(VOXELS)
    assert not preparation.chains
    assert [p.code for p in preparation.feasibility.problems] == ["disconnected"]
    with pytest.raises(InputError, match="2 parts"):
        _ = preparation.chain
    repaired = prepare_chain(VOXELS, repair=True)
    assert len(repaired.chain) == 3 * TETRAHEDRA_PER_RING
    assert "removed the other cell" in repaired.repaired


@pytest.mark.slow
def test_mesh_is_filled_with_tetrahedra() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    data = mesh.export(file_type="stl")
    small_chain, count = (prepare_chain(data, modules=n, method="blocks") for n in (72, 300))
    assert small_chain.likeness is not None
    assert count.likeness is not None
    assert 0.3 < small_chain.likeness.iou < count.likeness.iou < 1.0
    assert abs(len(count.chain) - 300) < 60
    report = count.report()
    assert report["module"] == "tetrahedron"
    assert len(report["positions"]) == len(report["wxyzs"]) == len(count.chain)
    assert len(report["line"]) == len(count.chain) + 1
    # The mesh lies where the chain does.
    vertices = np.array(report["mesh"]["vertices"])
    np.testing.assert_allclose(
        vertices.mean(axis=0), np.array(report["positions"]).mean(axis=0), atol=1.5
    )
    assert report["below"] % TETRAHEDRA_PER_RING == report["above"] % TETRAHEDRA_PER_RING == 0
