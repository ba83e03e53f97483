"""Prepared chains: a fold reads the chains of its preview, and only of the same search."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from planner.file_names import CANDIDATES, PREPARED
from planner.pathfinding.options import PathOptions
from planner.pipeline import reading
from planner.pipeline.prepare import Preparation, prepare
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stage
from planner.pipeline.workspace import Workspace
from planner.plan.prepared import PreparedChains, key_of

CELLS = b"\n".join(b"%d,%d,%d" % (x, y, z) for x in range(4) for y in range(2) for z in range(2))
OPTIONS = PathOptions(as_voxels=True, method="blocks")
KEY = key_of(CELLS, "bar.csv", OPTIONS, 3)


def previewed() -> Preparation:
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
    previewed().prepared().save(stored, KEY)
    monkeypatch.delattr(reading, "prepare")  # the second fold does not search
    assert read(stored) == expected
    assert not (stored / PREPARED).exists()


def test_load_with_another_key_or_of_a_damaged_file_returns_none(tmp_path: Path) -> None:
    previewed().prepared().save(tmp_path, KEY)
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
    made = previewed()
    assert made.repeatable
    for other in (
        replace(made, method="exact"),
        replace(made, chains=()),
        replace(made, not_started="No path starts there."),
    ):
        assert not other.repeatable
