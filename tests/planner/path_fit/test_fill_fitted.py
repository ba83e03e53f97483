"""Fitted paths: they look more like a mesh than blocks, and blocks stay where they are as good."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from foldback.planner.errors import InputError
from foldback.planner.path_fit.fill_fitted import check_exact, fill_fitted
from foldback.planner.path_fit.fit import GAP_COST, FittedPath, fit_path, ranked
from foldback.planner.path_fit.fit_table import (
    MAX_TABLE_FITTED_MODULES,
    SIDES,
    cost_of,
    fit_on_table,
)
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import (
    MIN_FITTED_GAIN,
    Preparation,
    check_for_table,
    prepare_subject,
)
from foldback.planner.readers import read
from foldback.planner.shapes.lattice_fits import Ladder
from tests.case import case
from tests.planner.solids_made import box, solid_of, torus


def prepared(mesh: trimesh.Trimesh, **options: object) -> Preparation:
    return prepare_subject(solid_of(mesh), PathOptions(**{"modules": 64, **options}))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def fitted_ring() -> Preparation:
    """Fitted path through a ring; tests must not change it."""
    return prepared(torus(), method="fitted")


def iou(preparation: Preparation) -> float:
    assert preparation.likeness is not None
    return preparation.likeness.iou


@pytest.mark.long
def test_auto_takes_a_fitted_path_where_it_pays(fitted_ring: Preparation) -> None:
    ring, blocks = prepared(torus()), prepared(torus(), method="blocks")
    assert ring.method == "fitted" and blocks.method == "blocks"
    assert iou(ring) >= iou(blocks) + MIN_FITTED_GAIN
    assert ring.knot is not None and ring.knot.verdict == "unknot"
    assert 0.9 * 64 <= len(ring.chain) <= 64
    assert len(ring.chains) == len(ring.likenesses) > 1
    # The path through blocks comes last, with its own likeness.
    assert ring.likenesses[-1] == blocks.likenesses[0]
    assert (ring.chains[-1].folded_rad == blocks.chain.folded_rad).all()
    assert (fitted_ring.cells == ring.cells).all()


@pytest.mark.long
def test_the_final_result_goes_on_from_the_first_one(monkeypatch: pytest.MonkeyPatch) -> None:
    options = PathOptions(modules=32)
    full_fit = fill_fitted(solid_of(torus()), options, seed=0)[1]
    first = fill_fitted(solid_of(torus()), options, seed=0, quick=True)[1]
    assert len(first.chains) == 1
    second = fill_fitted(solid_of(torus()), options, seed=1)[1]  # is not that fit's result
    quick_fit = fill_fitted(solid_of(torus()), options, seed=0, quick=True)[1]
    assert (quick_fit.cells == first.cells).all() and not np.array_equal(
        second.cells, full_fit.cells
    )
    monkeypatch.setattr(
        "foldback.planner.path_fit.fill_fitted.candidates", None
    )  # nothing starts anew
    final = fill_fitted(solid_of(torus()), options, seed=0)[1]
    assert (final.cells == full_fit.cells).all() and len(final.chains) == len(full_fit.chains)


def test_walls_much_thinner_than_a_module_are_closed() -> None:
    walls = [((4, 3, 0.03), (0, 0, 0.015))]
    walls += [((0.03, 3, 2.4), (x, 0, 1.2)) for x in (-1.985, 1.985)]
    walls += [((4, 0.03, 2.4), (0, y, 1.2)) for y in (-1.485, 1.485)]
    boxes = [trimesh.creation.box(size).apply_translation(at) for size, at in walls]
    mesh = trimesh.util.concatenate(boxes)
    assert isinstance(mesh, trimesh.Trimesh)
    tray = prepared(mesh, modules=96)
    assert tray.method == "fitted" and tray.likeness is not None and tray.voxels is not None
    assert tray.likeness.missing < 0.05
    assert tray.voxels.retention.tunnels == 0
    assert tray.voxels.retention.volume == pytest.approx(1.0 - tray.likeness.missing, abs=0.02)


def test_the_method_exact_meets_the_number_of_modules() -> None:
    for modules in (31, 32):
        assert len(prepared(torus(), method="exact", modules=modules).chain) == modules


def test_a_path_that_misses_the_exact_number_is_ranked_last_and_refused() -> None:
    fit = next(fit_path(Ladder(solid_of(torus()), SIDES[:1]), 32))
    (path,) = fit.paths
    assert (path.placement.worth == path.placement.fill).all() and path.score == path.iou
    flat = np.array(np.ravel_multi_index(tuple(path.cells.T), path.placement.fill.shape))
    scores = [FittedPath.along(path.placement, flat, holes).score for holes in (0, 1)]
    assert scores == [path.score - GAP_COST, path.score]  # the ring's hole is no gap
    short = replace(path, cells=path.cells[:-1], score=1.0)
    assert ranked([short, path], len(path.cells)) == [path, short]
    assert ranked([short, path], len(short.cells)) == [short, path]
    check_exact(32, 32)
    with pytest.raises(InputError, match="got a path of 31 cells, expected one of exactly 32"):
        check_exact(31, 32)


@pytest.mark.long
def test_auto_fits_a_path_for_a_table() -> None:
    # The cells that look most like it have no path that rises from the floor.
    ring = {"modules": 32, "world": "table"}
    assert not prepared(torus(), method="exact", **ring).chains
    preparation = prepared(torus(), **ring)
    assert preparation.method == "fitted" and 0.9 * 32 <= len(preparation.chain) <= 32
    assert len(preparation.chains) == len(preparation.likenesses)
    for chain in preparation.chains:
        check_for_table(chain)
    fits = fit_on_table(Ladder(solid_of(torus()), SIDES), 32)
    costs = [fit.cost for fit in fits]
    assert len(fits) > 1 and costs == sorted(costs)
    path = fits[0].fitted
    assert (path.cells - path.cells.min(axis=0) == preparation.cells).all()
    assert cost_of(path.cells, path.iou) == fits[0].cost
    assert cost_of(path.cells, path.iou - 0.1) == pytest.approx(costs[0] + 2.0)
    # A ring of 32 cells lies in one or two layers.
    assert np.ptp(path.cells[:, 2]) <= 1


def test_refusal_of_many_modules_on_a_table_names_the_number_that_works() -> None:
    preparation = prepared(torus(), modules=MAX_TABLE_FITTED_MODULES + 1, world="table")
    with pytest.raises(InputError, match=f"With at most {MAX_TABLE_FITTED_MODULES} modules"):
        _ = preparation.chain


@pytest.mark.long
def test_on_a_table_an_easier_path_through_voxels_stays() -> None:
    preparation = prepared(box(4, 4, 2), modules=32, world="table")
    assert preparation.method == "table" and iou(preparation) > 0.95


def test_auto_keeps_blocks_for_a_box() -> None:
    assert prepared(box(4, 4, 4)).method == "blocks"


@pytest.mark.long
def test_a_fitted_path_needs_fewer_modules_for_a_likeness() -> None:
    fitted, blocks = (
        prepare_subject(
            solid_of(torus()), PathOptions(modules=24, method=method), offering=True
        ).reach[0.75]
        for method in ("auto", "blocks")
    )
    assert fitted is not None and blocks is not None
    assert 2 * fitted < blocks
    assert iou(prepared(torus(), modules=fitted)) >= 0.75


@pytest.mark.long
def test_the_ends_and_the_start_are_as_requested(fitted_ring: Preparation) -> None:
    for name, expected in {"start": None, "ends": "surface"}.items():
        with case(name):
            cells = fitted_ring.cells
            start = tuple(cells[len(cells) // 2].tolist())
            options = {"start": start} if expected is None else {"ends": expected}
            preparation = prepared(torus(), method="fitted", **options)
            assert sorted(preparation.cells.tolist()) == sorted(cells.tolist())
            assert (
                preparation.not_started or expected or tuple(preparation.cells[0].tolist()) == start
            )


def test_the_method_fitted_needs_a_mesh_in_zero_gravity() -> None:
    cells = read(b"[[0,0,0],[1,0,0],[1,1,0]]", filename="a.json", as_voxels=True)
    refused = {
        "cells": (cells, {}),
        "table": (solid_of(torus()), {"world": "table"}),
        "too many": (solid_of(torus()), {"modules": 5000}),
    }
    for name, (expected_error, options) in refused.items():
        with case(name), pytest.raises(InputError, match="got .*fitted"):
            prepare_subject(expected_error, PathOptions(method="fitted", **options))  # type: ignore[arg-type]


def test_cells_are_where_the_mesh_is(fitted_ring: Preparation) -> None:
    assert fitted_ring.voxels is not None and fitted_ring.filled is not None
    mesh = fitted_ring.report()["mesh"]
    middle = np.array(mesh["vertices"]).mean(axis=0)
    assert np.abs(middle - fitted_ring.chain.folded_poses.positions.mean(axis=0)).max() < 0.5


def test_cells_begin_where_a_box_does() -> None:
    mesh = box(4, 5, 6)
    mesh.apply_translation([0.3, 0.4, 0.1])
    ladder = Ladder(solid_of(mesh), (np.eye(3),))
    first = next(fit_path(ladder, 120)).paths[0]
    assert first.placement.bound > 0.99 and first.iou > 0.97
