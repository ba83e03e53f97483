"""Stored runs of benchmarks."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.success_map.stored import run_missing, stored
from foldback.planner.progress import Progress

# Any frozen dataclass is suitable.
CASES = [Progress(stage="explode", fraction=0.0, steps=k) for k in range(7)]


def fail_if_run(case: Progress) -> dict[str, Any]:
    raise AssertionError(case)


def test_stored_runs_are_not_repeated(tmp_path: Path) -> None:
    path = tmp_path / "out" / "runs.jsonl"
    assert run_missing(path, CASES, fail_if_run, minutes=-1.0) == []
    assert len(run_missing(path, CASES[2:4], asdict)) == 2
    rows = run_missing(path, CASES, asdict, workers=2)
    assert sorted(row["steps"] for row in rows) == list(range(7))
    assert run_missing(path, CASES, fail_if_run, workers=2) == rows
    assert len(path.read_text().splitlines()) == 7
    assert set(stored(path, Progress)) == set(CASES)
