"""Stored runs, tables and seeds of benchmarks."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bench.measured_tables import Section
from bench.success_map.stored import run_missing, stored
from planner.progress import Progress

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


def test_section_is_plain_json() -> None:
    section = Section(name="some")
    section.add("fast enough", "1 s", "< 2 s", bool(np.float64(1.0) < 2.0))
    section.add("also", "1 s", "< 2 s", np.float64(1.0) < 2.0)  # pyright: ignore
    section.add("reported", "1 s")
    found = json.loads(json.dumps(section.as_dict()))
    assert [figure["met"] for figure in found["figures"]] == [True, True, None]
