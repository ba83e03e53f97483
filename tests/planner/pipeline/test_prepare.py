import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pipeline import reading
from foldback.planner.pipeline.prepare import Preparation, prepare
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.prepared_chains import PreparedChains, key_of
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.storage.file_names import CANDIDATES, PREPARED
from tests.planner.chains import coil
from tests.planner.conftest import SHAPES
from tests.refusal import refused

CUBE_OBJ = (
    "".join(f"v {x} {y} {z}\n" for x in (0, 4) for y in (0, 4) for z in (0, 4))
    + "f 1 2 4\nf 1 4 3\nf 5 8 6\nf 5 7 8\nf 1 5 6\nf 1 6 2\n"
    + "f 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
).encode()


def voxels(cells: Any) -> bytes:
    return json.dumps({"format": "foldback-voxels/1", "name": "v", "cells": cells}).encode()


def test_paths_and_chains_are_used_unchanged() -> None:
    report = prepare((SHAPES / "wrench-24.json").read_bytes(), "wrench-24.json").report()
    assert (report["kind"], report["modules"], report["candidates"]) == ("path", 24, 1)
    assert report["cells"] == json.loads((SHAPES / "wrench-24.json").read_bytes())["cells"]
    assert report["knot"]["verdict"] == "unknot"
    assert report["feasibility"] is None
    chain = coil(12)
    prepared = prepare(write_chain(chain), "coil.json", PathOptions(modules=40))
    np.testing.assert_allclose(prepared.chain.folded_rad, chain.folded_rad)
    assert "12 modules" in prepared.notes[0]


@pytest.mark.slow
def test_mesh_becomes_different_chains_of_the_same_cells() -> None:
    prepared = prepare(CUBE_OBJ, "cube.obj", PathOptions(modules=64))
    report = prepared.report()
    assert (report["kind"], report["method"], report["modules"]) == ("mesh", "blocks", 64)
    assert report["iou"] > 0.99
    cells = np.array(report["cells"])
    assert (np.abs(np.diff(cells, axis=0)).sum(axis=1) == 1).all()
    assert len(np.unique(cells, axis=0)) == 64
    # The mesh encloses the cells: the same box, half a cell around the outermost centres.
    mesh = np.array(report["mesh"]["vertices"])
    np.testing.assert_allclose(mesh.min(axis=0), cells.min(axis=0) - 0.5, atol=0.26)
    np.testing.assert_allclose(mesh.max(axis=0), cells.max(axis=0) + 0.5, atol=0.26)
    assert len(prepared.chains) >= 2
    filled = [
        {tuple(cell) for cell in np.rint(chain.folded_poses.positions).astype(int).tolist()}
        for chain in prepared.chains
    ]
    assert all(cells == filled[0] for cells in filled)
    angles = {chain.folded_rad.tobytes() for chain in prepared.chains}
    assert len(angles) == len(prepared.chains)
    start = report["cells"][14]
    started = prepare(CUBE_OBJ, "cube.obj", PathOptions(modules=64, start=tuple(start)))
    starts = [chain.folded_poses.positions[0].tolist() for chain in started.chains]
    assert starts == [start] * len(started.chains)
    assert started.not_started == ()


def test_voxels_without_a_path_are_repaired_or_doubled_on_request() -> None:
    # A plus: five cells, four of them dead ends.
    plus = [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]
    prepared = prepare(voxels(plus), "plus.json")
    report = prepared.report()
    assert report["has_path"] is False
    assert report["feasibility"]["feasible"] is False
    assert report["feasibility"]["problems"]
    with refused("no-path"):
        _ = prepared.chain
    repaired = prepare(voxels(plus), "plus.json", PathOptions(repair=True))
    assert repaired.chains
    assert repaired.repaired
    assert f"Repaired: {repaired.repaired}" in repaired.prepared().notes
    blocks = prepare(voxels(plus), "plus.json", PathOptions(method="blocks")).chain
    assert (len(blocks), blocks.pitch_m) == (40, pytest.approx(0.005))


def test_number_of_modules_out_of_range_is_refused() -> None:
    for modules in (3, 10**9):
        with refused("bad-modules"):
            prepare(CUBE_OBJ, "cube.obj", PathOptions(modules=modules))


def test_start_without_a_path_gives_another_path_and_a_note() -> None:
    cells = np.argwhere(np.ones((3, 3, 3))).tolist()
    prepared = prepare(voxels(cells), "box.json", PathOptions(start=(1, 0, 0)))
    assert [reason.code for reason in prepared.not_started] == ["not-started", "start-colour"]
    assert prepared.report()["cells"][0] != [1, 0, 0]
    with refused("no-start", match="Choose another start"):
        _ = prepared.chain


CELLS = b"\n".join(b"%d,%d,%d" % (x, y, z) for x in range(4) for y in range(2) for z in range(2))
OPTIONS = PathOptions(as_voxels=True, method="blocks")
KEY = key_of(CELLS, "bar.csv", OPTIONS, 3)


def preparation() -> Preparation:
    return prepare(CELLS, "bar.csv", OPTIONS, seed=3)


def read(directory: Path) -> tuple[dict[str, Any], bytes]:
    request = FoldRequest(filename="bar.csv", as_voxels=True, method="blocks", seed=3)
    Workspace(directory).write_request(request, CELLS)
    return run_stage("read", directory), (directory / CANDIDATES).read_bytes()


def test_read_of_stored_chains_equals_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched, stored = tmp_path / "searched", tmp_path / "stored"
    for directory in (searched, stored):
        directory.mkdir()
    expected = read(searched)
    preparation().prepared().save(stored, KEY)
    monkeypatch.delattr(reading, "prepare")  # the second fold does not search
    assert read(stored) == expected
    assert not (stored / PREPARED).exists()


def test_load_with_another_key_or_of_a_damaged_file_returns_none(tmp_path: Path) -> None:
    preparation().prepared().save(tmp_path, KEY)
    for key in (
        key_of(CELLS + b"\n", "bar.csv", OPTIONS, 3),
        key_of(CELLS, "other.csv", OPTIONS, 3),
        key_of(CELLS, "bar.csv", replace(OPTIONS, ends="surface"), 3),
        key_of(CELLS, "bar.csv", OPTIONS, 4),
    ):
        assert PreparedChains.load(tmp_path, key) is None
    assert PreparedChains.load(tmp_path, KEY) is not None
    for text in ("", "{", "[]", '{"key": "KEY"}', '{"key": "KEY", "chains": [1]}'):
        (tmp_path / PREPARED).write_text(text.replace("KEY", KEY))
        assert PreparedChains.load(tmp_path, KEY) is None, text


def test_searches_that_the_clock_may_end_are_not_repeatable() -> None:
    made_preparation = preparation()
    assert made_preparation.repeatable
    for other_settings in (
        replace(made_preparation, method="exact"),
        replace(made_preparation, chains=()),
        replace(made_preparation, not_started=(PathReason.of(PathCode.NO_SURFACE_ENDS),)),
    ):
        assert not other_settings.repeatable
