"""Sections whose folds are sweeps: their specs, and the figures of rows."""

from typing import Any

import pytest

from bench.stored_sweeps import results_of
from bench.sweep_sections import SPECS, gallery_section, seeds_section
from foldback.planner.sweeps.spec import SweepSpec

pytestmark = pytest.mark.slow


def row(shape: str, verified: bool, attempts: int | None, seed: int = 0) -> dict[str, Any]:
    about = {"group": "mesh", "shape": shape, "seed": seed, "cpu_s": 2.0, "wall_s": 3.0}
    return {**about, "verified": verified, "attempts": attempts}


def test_folds_that_needed_the_portfolio_are_shown() -> None:
    rows = [row("a", True, 1), row("b", True, 3), row("c", False, 6), row("d", False, None)]
    section = seeds_section(rows)
    assert [shown["shape"] for shown in section.rows] == ["b", "c", "d"]
    figures = {figure.name: (figure.value, figure.met) for figure in section.figures}
    assert figures["mesh: verified at once"] == ("1 of 4 (25.0 %)", False)
    assert figures["mesh: verified with the portfolio"] == ("2 of 4", False)


def test_last_seed_of_a_shape_counts_for_the_gallery() -> None:
    section = gallery_section([row("b", True, 1, seed=1), row("a", True, 1), row("b", False, 6)])
    figures = {figure.name: (figure.value, figure.met) for figure in section.figures}
    assert figures["verified at once"] == ("1 of 2 (50.0 %)", False)
    assert figures["verified with retries"] == ("2 of 2", True)


def test_folds_that_were_killed_or_lost_count_as_not_verified() -> None:
    """Their rows have no attempts, and those of lost ones no times."""
    columns = {"group": "mesh", "seed": 0, "verified": False, "modules": None, "shape_digest": "a"}
    killed = {**columns, "shape": "k", "verdict": "time limit", "cpu_s": 2.0, "wall_s": 3.0}
    lost = {**columns, "shape": "l", "verdict": "lost"}
    rows = [row("a", True, 1), killed, lost]
    figures = {figure.name: figure.value for figure in seeds_section(rows).figures}
    assert figures["mesh: verified with the portfolio"] == "1 of 3"
    assert figures["mesh: processor, median and most"] == "2.0 s, 2.0 s"
    assert gallery_section(rows).rows[-1]["verdict"] == "lost"
    assert results_of([killed, lost])["l"]["cpu_s"] is None


@pytest.mark.parametrize("path", sorted(SPECS.glob("*.toml")), ids=lambda path: path.stem)
def test_specs_can_be_read(path: Any) -> None:
    assert SweepSpec.from_toml(path).shapes
