"""Run the missing experiments, and write the page from the stored runs."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from bench.reproduction.document import document
from bench.reproduction.experiments import Experiment
from bench.reproduction.page_text import told
from bench.reproduction.runs import Case, run, stored_runs
from bench.success_map.stored import run_missing, stored


def reproduce(
    experiments: list[Experiment],
    every: tuple[Experiment, ...],
    files: Path,
    *,
    repeats: bool = False,
    minutes: float = float("inf"),
    workers: int = 1,
) -> None:
    """Run the requested experiments that are not stored.

    Args:
        experiments: Experiments to run, at least one.
        every: All experiments; rows of others are deleted.
        files: Directory of rows, films and pictures.
        repeats: True to repeat stored experiments.
        minutes: Minutes after which no further experiment is started.
        workers: Number of experiments at the same time.
    """
    rows = files / "runs.jsonl"
    cases = {
        Case(id=experiment.id, asked=experiment.asked): experiment for experiment in experiments
    }
    all_cases = {Case(id=experiment.id, asked=experiment.asked) for experiment in every}
    # Rows of experiments whose request has changed are deleted.
    kept_rows = [
        row
        for case, row in (stored(rows, Case) if rows.exists() else {}).items()
        if case in all_cases and not (repeats and case in cases)
    ]
    files.mkdir(parents=True, exist_ok=True)
    rows.write_text("".join(json.dumps(row) + "\n" for row in kept_rows), encoding="utf-8")
    run_missing(rows, list(cases), partial(_run, cases, files), minutes=minutes, workers=workers)


def _run(cases: dict[Case, Experiment], files: Path, case: Case) -> dict[str, Any]:
    row = run(cases[case], files)
    print(
        f"{case.id}: {row['verdict']}, {row['wall_s']:.0f} s wall, {row['processor_s']:.0f} s "
        f"processor, {row['folder_mb']:.1f} MB",
        flush=True,
    )
    return row


def tell(every: tuple[Experiment, ...], files: Path, paper: Path) -> None:
    """Write the page's data and the document; delete the pictures of unknown experiments."""
    runs = stored_runs(files / "runs.jsonl")
    page = told(runs, every)
    for folder in files.iterdir():
        if folder.is_dir() and folder.name not in runs:
            shutil.rmtree(folder)
    (files / "page.json").write_text(json.dumps(page, indent=1) + "\n", encoding="utf-8")
    paper.write_text(document(page), encoding="utf-8")
