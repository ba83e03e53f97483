"""The success map runs its cases, goes on where it was, and draws what it knows."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path as FilePath

import numpy as np
import pytest

from bench.success_map import __main__ as success
from bench.success_map.__main__ import (
    BOXES,
    KINDS,
    METHODS,
    Case,
    cases,
    path_of,
    run,
)
from bench.success_map.picture import picture
from bench.success_map.stored import stored
from planner.chain.path import Path

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_path_fills_the_box(kind: str) -> None:
    paths = [path_of(kind, BOXES[64], seed) for seed in range(2)]
    for cells in paths:
        assert np.array_equal(np.unique(cells, axis=0), np.argwhere(np.ones(BOXES[64], dtype=bool)))
        Path.from_cells([tuple(cell) for cell in cells.tolist()], name="box")  # it is a path


FEW = ("snake", "random")


@pytest.mark.long
def test_baseline_fails_where_the_explosion_succeeds() -> None:
    bad, good = (
        run(Case(method=method, kind="block", modules=64, seed=0))
        for method in ("one-by-one", "simultaneous")
    )
    assert bad["verdict"].startswith("failed: in the plan, modules") and "overlap" in bad["verdict"]
    assert good["verdict"] == "verified (simulated)" and good["seconds"] > 0.0


def test_cases_are_unique_and_large_ones_limited_to_methods_that_end() -> None:
    found = list(cases(4096))
    assert len(found) == len(set(found))
    assert {case.method for case in found} == set(METHODS)
    assert {case.method for case in found if case.modules == 4096} == {"one-by-one", "peel", "auto"}
    assert max(case.modules for case in cases(64)) == 64


@pytest.mark.long
def test_success_map_continues_an_earlier_run(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, drawing = tmp_path / "runs.jsonl", tmp_path / "map.svg"
    monkeypatch.setattr(success, "RUNS_FILE", runs)
    monkeypatch.setattr(success, "PICTURE", drawing)
    monkeypatch.setattr(success, "BOXES", {32: BOXES[32]})
    monkeypatch.setattr(success, "METHODS", {"one-by-one": METHODS["one-by-one"]})
    monkeypatch.setattr(success, "RUNS_PER_KIND", {32: 1})
    monkeypatch.setattr(success, "KINDS", FEW)
    monkeypatch.setattr(success, "warm_up", lambda: None)
    monkeypatch.setattr("sys.argv", ["success-map"])
    success.main()
    first = runs.read_text()
    assert len(first.splitlines()) == len(FEW)
    success.main()
    assert runs.read_text() == first
    assert {case.kind for case in stored(runs, Case)} == set(FEW)
    drawn = ElementTree.parse(drawing).getroot()
    titles = [element.text for element in drawn.iter() if element.tag.endswith("title")]
    assert "0 of 1 verified" in titles
    assert all(json.loads(line)["verdict"] for line in first.splitlines())


def test_picture_shows_shares_of_verified_folds() -> None:
    shares = {
        ("a", "x", 8): (2, 0, 2),
        ("a", "y", 8): (0, 0, 2),
        ("b", "x", 8): (1, 0, 2),
        ("b", "y", 8): (0, 2, 2),
    }
    drawn = ElementTree.fromstring(picture(shares, ("a", "b"), ("x", "y"), (8,)))
    cells = {
        parts[0].text: [(part.get("class"), part.get("height")) for part in parts[1:]]
        for parts in (list(cell) for cell in drawn.iter() if cell.tag.endswith("}g"))
    }
    assert cells == {
        "2 of 2 verified (simulated)": [("cell", "21"), ("good", "21.0")],
        "1 of 2 verified (simulated)": [("cell", "21"), ("good", "10.5")],
        "2 of 2 verified (kinematics only)": [("cell", "21"), ("kinematics", "21.0")],
        "0 of 2 verified": [("cell", "21"), ("cross", None)],
    }
