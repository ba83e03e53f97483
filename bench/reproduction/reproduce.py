"""Run the missing experiments, and write the page from the stored runs."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Final

from bench.reproduction.document import document
from bench.reproduction.experiments import Experiment
from bench.reproduction.page_text import told
from bench.reproduction.runs import run, stored_runs
from foldback.planner.progress import Cancelled
from foldback.planner.sweeps.case import Case, Limits, Row
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.run import run_cases

LIMITS: Final = Limits(cpu_s=7200.0, wall_s=14_400.0, memory_bytes=8 * 2**30)
"""Limits of each experiment; the slowest takes some minutes."""


def reproduce(
    experiments: list[Experiment],
    every: tuple[Experiment, ...],
    files: Path,
    *,
    repeats: bool = False,
    workers: int = 1,
) -> None:
    """Run the requested experiments that are not stored.

    Args:
        experiments: Experiments to run.
        every: All experiments; rows of others, and of those with another request, are deleted.
        files: Directory of rows, films and pictures.
        repeats: True to repeat stored experiments.
        workers: Number of experiments at the same time.
    """
    path = files / "runs.jsonl"
    requests = {experiment.id: experiment.asked for experiment in every}
    again = {experiment.id for experiment in experiments if repeats}
    runs = {
        id_: stored
        for id_, stored in stored_runs(path).items()
        if requests.get(id_) == stored.asked and id_ not in again
    }
    files.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps(asdict(stored)) + "\n" for stored in runs.values()]
    path.write_text("".join(lines), encoding="utf-8")
    cases = [
        Case(key=experiment.id, columns={}, task=partial(_row, experiment, files), limits=LIMITS)
        for experiment in experiments
        if experiment.id not in runs
    ]

    def add(row: Row) -> None:
        if "run" in row:
            with path.open("a", encoding="utf-8") as file:
                file.write(f"{row['run']}\n")

    if not cases:
        return
    with executor_on(Place(workers=workers)) as executor:
        for row in run_cases(cases, add, executor, at_once=executor.at_once):
            print(*(row.get(name, "") for name in ("key", "verdict", "error", "cpu_s")), flush=True)


def _row(experiment: Experiment, files: Path, cancelled: Cancelled) -> Row:
    del cancelled  # an experiment is not worth anything without its end
    result = run(experiment, files)
    return {"verdict": result.verdict, "run": json.dumps(asdict(result))}


def tell(every: tuple[Experiment, ...], files: Path, paper: Path) -> None:
    """Write the page's data and the document; delete the pictures of unknown experiments."""
    runs = stored_runs(files / "runs.jsonl")
    page = told(runs, every)
    for folder in files.iterdir():
        if folder.is_dir() and folder.name not in runs:
            shutil.rmtree(folder)
    (files / "page.json").write_text(json.dumps(page, indent=1) + "\n", encoding="utf-8")
    paper.write_text(document(page), encoding="utf-8")
