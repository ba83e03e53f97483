"""Folds with several seeds: run once each, and grouped by how they were verified."""

from typing import Any

from bench.success_map.seeds import section_of


def test_folds_that_needed_the_portfolio_are_shown() -> None:
    def row(shape: str, verified: bool, attempts: int) -> dict[str, Any]:
        named = {"kind": "gallery", "shape": shape, "seed": 0}
        return {**named, "verified": verified, "attempts": attempts, "cpu s": 2.0}

    section = section_of([row("a", True, 1), row("b", True, 3), row("c", False, 6)])
    assert [computed_row["shape"] for computed_row in section.rows] == ["b", "c"]
    figures = {figure.name: (figure.value, figure.met) for figure in section.figures}
    assert figures["gallery: verified at once"] == ("1 of 3 (33.3 %)", False)
    assert figures["gallery: verified with the portfolio"] == ("2 of 3", False)
