"""Stored runs go on where they were, one at a time or several."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.success_map.stored import run_missing, stored, version_of
from planner.progress import Progress

# Any frozen dataclass will do.
CASES = [Progress(stage="explode", fraction=0.0, steps=k) for k in range(7)]


def nothing(case: Progress) -> dict[str, Any]:
    raise AssertionError(case)


def test_what_is_stored_is_not_run_again(tmp_path: Path) -> None:
    path = tmp_path / "out" / "runs.jsonl"
    assert run_missing(path, CASES, nothing, minutes=-1.0) == []
    assert len(run_missing(path, CASES[2:4], asdict)) == 2
    rows = run_missing(path, CASES, asdict, workers=2)
    assert sorted(row["steps"] for row in rows) == list(range(7))
    assert run_missing(path, CASES, nothing, workers=2) == rows
    assert len(path.read_text().splitlines()) == 7
    assert set(stored(path, Progress)) == set(CASES)


def test_versions_of_packages_differ() -> None:
    assert version_of("planner") == version_of("planner") != version_of("server")
