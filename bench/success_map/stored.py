"""Stored runs: a long benchmark can be stopped at any time and continues where it stopped."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from foldback.planner.progress import Cancelled, never

if TYPE_CHECKING:
    from foldback.planner.pipeline.request import FoldRequest

Case = TypeVar("Case")
Row = dict[str, Any]


def version_of(package: str) -> str:
    """Return the first eight hex digits of a digest of the modules of a package."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for module in sorted((root / package).rglob("*.py")):
        digest.update(str(module.relative_to(root)).encode() + module.read_bytes())
    return digest.hexdigest()[:8]


def stored(path: Path, kind: type[Case]) -> dict[Case, Row]:
    """Return the rows of a file by their case, a dataclass whose fields the rows contain."""
    names = tuple(field.name for field in fields(kind))  # type: ignore[arg-type]
    lines = path.read_text().splitlines() if path.exists() else []
    rows = [json.loads(line) for line in lines]
    return {kind(**{name: row[name] for name in names}): row for row in rows}


def run_missing(
    path: Path,
    cases: Iterable[Case],
    run: Callable[[Case], Row],
    *,
    minutes: float = float("inf"),
    workers: int = 1,
) -> list[Row]:
    """Run the cases that a file lacks, append their rows, and return all of its rows.

    Args:
        path: File with one JSON object per line; created if it does not exist.
        cases: All cases, in the order in which they are run.
        run: Returns the row of a case, in a separate process.
        minutes: Minutes after which no further case is started.
        workers: Number of cases at the same time.
    """
    wanted_cases = list(cases)
    rows = stored(path, type(wanted_cases[0]))
    path.parent.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + 60.0 * minutes
    missing = (case for case in wanted_cases if case not in rows)
    due = (case for case in missing if time.monotonic() <= until)
    for case, row in _each(due, run, workers):
        rows[case] = row
        with path.open("a") as file:
            file.write(json.dumps(row) + "\n")
    return list(rows.values())


def _each(
    cases: Iterator[Case], run: Callable[[Case], Row], workers: int
) -> Iterator[tuple[Case, Row]]:
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        running: dict[Future[Row], Case] = {}
        while True:
            fresh = islice(cases, workers - len(running))
            running |= {pool.submit(run, case): case for case in fresh}
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), future.result()


def judge(
    directory: Path, request: FoldRequest, data: bytes, *, cancelled: Cancelled = never
) -> dict[str, Any]:
    """Fold up to the certificate, which contains the verdict; return its figures.

    Raises:
        InputError: If the input cannot be used.
    """
    # Imported late: processes that run other cases would import all of the planner.
    from foldback.planner.pipeline.stages import run_stages
    from foldback.planner.pipeline.workspace import Workspace

    Workspace(directory).write_request(request, data)
    return run_stages(directory, until="export", cancelled=cancelled)
