"""Offers: similar shapes with a path, for shapes without one on a table."""

from typing import cast

import numpy as np
import pytest
import trimesh

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.fill_cubes import BLOCK_CELLS
from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES, PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.table_paths.fill_table import TableCubes
from foldback.planner.table_paths.mending import cells_to_add
from foldback.planner.table_paths.offers import table_offers
from foldback.planner.table_paths.rules import FALLS, rule_violations
from tests.planner.table_search import reasons_for_no_path

HOLES = ((1, 2), (3, 2))
SURPLUS = np.array([(x, y, 0) for x in range(5) for y in range(5) if (x, y) not in HOLES])
"""Slab with 13 cells of one chessboard colour and 10 of the other."""
SMALL = np.array([(x, y, 0) for x in range(3) for y in range(3) if (x, y) != (1, 0)])
"""Small slab with a surplus: eight times as many cells are still few enough for a table."""
TORUS = cast(
    "bytes", trimesh.creation.torus(major_radius=10, minor_radius=4).export(file_type="stl")
)


def test_cells_to_add_to_a_surplus_of_one_colour_gives_a_path() -> None:
    assert reasons_for_no_path(SURPLUS)
    added = cells_to_add(SURPLUS)
    assert 0 < len(added) <= len(HOLES)
    assert not reasons_for_no_path(np.concatenate([SURPLUS, np.array(added)]), turned=False)


def test_offers_of_cells_are_a_repair_and_blocks_with_paths() -> None:
    shape = Shape.from_cells(SMALL)
    data = str(SMALL.tolist()).encode()
    options = PathOptions(world="table", as_voxels=True)
    offers = list(table_offers(shape, options))
    assert [offer.kind for offer in offers] == ["repair", "blocks"]
    for offer in offers:
        preparation = prepare(data, "slab.json", offer.options(options))
        assert len(preparation.chain) == offer.modules
        assert not rule_violations(preparation.cells)
        assert set(preparation.filled.added if preparation.filled else ()) == set(offer.added)
        assert set(offer.added) <= set(map(tuple, preparation.cells.tolist()))


def test_refusal_for_a_table_names_the_nearest_cells_with_a_path() -> None:
    shape = Shape.from_cells(SMALL)
    (added,) = cells_to_add(SMALL)
    words = f"Possible repair: add the cell {added}, for {len(SMALL) + 1} modules."
    options = PathOptions(world="table", as_voxels=True)
    with pytest.raises(InputError) as refusal:
        TableCubes().check(shape, options)
    with pytest.raises(InputError) as later:
        _ = prepare(str(SMALL.tolist()).encode(), "slab.json", options).chain
    assert words in refusal.value.detail
    assert words in later.value.detail


def test_repaired_cells_of_a_mesh_stay_in_place() -> None:
    moved = Shape.from_cells(SMALL + [3, 2, 0])
    options = PathOptions(world="table", repair=True)
    filled = TableCubes().fill(moved, options, of_solid=True, seed=0, time_limit_s=20.0)
    laid = moved.cells + 0.5 + filled.shift
    assert {*map(tuple, laid.tolist())} | set(filled.added) == {*map(tuple, filled.cells.tolist())}


def test_offers_of_cells_too_many_for_a_table_are_no_blocks() -> None:
    options = PathOptions(world="table", as_voxels=True)
    assert BLOCK_CELLS * len(SURPLUS) > MAX_TABLE_MODULES
    assert {offer.kind for offer in table_offers(Shape.from_cells(SURPLUS), options)} == {"repair"}


def test_first_offer_for_a_torus_has_a_path() -> None:
    options = PathOptions(modules=30, method="exact", world="table")
    assert not prepare(TORUS, "torus.stl", options).chains
    solid = read(TORUS, filename="torus.stl")
    assert isinstance(solid, Solid)
    offer = next(table_offers(solid, options))
    preparation = prepare(TORUS, "torus.stl", offer.options(options))
    assert len(preparation.chain) == offer.modules <= MAX_TABLE_MODULES
    assert not rule_violations(preparation.cells, rule=FALLS)


def test_cancelled_search_gives_no_offers() -> None:
    options = PathOptions(world="table", as_voxels=True)
    assert not list(table_offers(Shape.from_cells(SURPLUS), options, cancelled=lambda: True))
