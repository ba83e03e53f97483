"""Folds with several seeds are run once each, and told apart by how they came to be verified."""

from __future__ import annotations

from typing import Any

import pytest

from bench.success_map import seeds
from bench.success_map.seeds import SEEDS_PER_SHAPE, Case, cases, run, section_of

pytestmark = pytest.mark.slow


def test_every_shape_comes_with_every_seed() -> None:
    found = list(cases())
    assert len(found) == len(set(found))
    shapes = {(case.kind, case.shape) for case in found}
    assert len(found) == SEEDS_PER_SHAPE * len(shapes)
    assert {case.seed for case in found[: len(shapes)]} == {0}
    assert {kind for kind, _ in shapes} == {"gallery", "mesh"}


@pytest.mark.long
def test_gallery_shape_and_mesh_are_folded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeds, "MESH_MODULES", 24)
    for case in (
        Case(kind="gallery", shape="letter-l", seed=1),
        Case(kind="mesh", shape="bracket", seed=0),
    ):
        row = run(case)
        assert row["verdict"] == "verified (simulated)"
        assert (row["kind"], row["shape"], row["seed"]) == (case.kind, case.shape, case.seed)
        assert row["modules"] >= 16 and row["attempts"] >= 1


def test_folds_that_needed_the_portfolio_are_shown() -> None:
    def row(shape: str, verdict: str, attempts: int) -> dict[str, Any]:
        named = {"kind": "gallery", "shape": shape, "seed": 0}
        return {**named, "verdict": verdict, "attempts": attempts, "cpu s": 2.0}

    section = section_of(
        [row("a", "verified", 1), row("b", "verified", 3), row("c", "failed: x", 6)]
    )
    assert [found["shape"] for found in section.rows] == ["b", "c"]
    told = {figure.name: (figure.value, figure.met) for figure in section.figures}
    assert told["gallery: verified at once"] == ("1 of 3 (33.3 %)", False)
    assert told["gallery: verified with the portfolio"] == ("2 of 3", False)
