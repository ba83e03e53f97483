"""Sweep of very many folds: memory of its command, first row, and a second run without work.

``python -m bench.sweeps.many DIRECTORY NUMBER`` is the command: a sweep of one shape with many
seeds on Dask. Its folds compute nothing, in Dask's workers themselves, so that it takes minutes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import psutil

from bench.command import PEAK_MEMORY_LINE
from bench.sections import Section
from foldback.planner.sweeps.case import Case, Outcome, Row
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.sweep import Sweep

MANY_FOLDS: Final = 100_000
"""Number of folds."""
MAX_COMMAND_MB: Final = 500
"""Largest resident memory of the command, MB, with Dask's scheduler."""
MAX_FIRST_ROW_S: Final = 5.0
"""Latest time of the first row after the workers have started, s."""
MAX_SECOND_RUN_S: Final = 10.0
"""Longest time of a second run, from start to end of its process, s."""
WORKERS: Final = 2
"""Number of Dask's workers."""
FIGURES: Final[Row] = {
    **{"module": "cube", "verdict": "verified", "verified": True, "simulated": True},
    **{"reason": None, "clearance_bound_pitch": 0.0123456789, "min_clearance_pitch": 0.0234567891},
    **{"frames": 400, "steps": 12345, "attempts": 1, "strategy": "simultaneous"},
    **{"cpu_s": 1.234, "wall_s": 1.345, "memory_mb": 123.4, "host": "node-123"},
    **{"processor": "a processor", "started_at": "2026-01-01T00:00:00+00:00"},
}
"""Figures of an empty fold, as many as those of another one."""


class EmptyFolds(Executor):
    """Executor on Dask whose folds compute nothing."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def submit(self, fn: Any, case: Case, /) -> Future[Any]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Submit an empty fold in place of a case."""
        del fn
        return self._executor.submit(empty_fold, case)


def empty_fold(case: Case, **options: object) -> Outcome:
    """Return the row of a fold."""
    del options
    return Outcome(row={"key": case.key, **case.columns, **FIGURES})


def main() -> None:
    """Run the sweep; print its rows, the time of the first one (s) and the peak memory (MB)."""
    directory, number = Path(sys.argv[1]), int(sys.argv[2])
    sweep = Sweep([("bar.json", b"[[0,0,0],[1,0,0],[1,1,0]]")], seeds=f"0-{number - 1}")
    first_row_s, rows, children_mb = 0.0, 0, 0.0
    if any(directory.iterdir()):
        rows = len(list(sweep.rows(directory, executor=ThreadPoolExecutor(1))))
    else:
        with executor_on(Place(workers=WORKERS)) as executor:
            start_s = time.monotonic()
            for _ in sweep.rows(directory, executor=EmptyFolds(executor), workers=WORKERS):
                first_row_s = first_row_s or time.monotonic() - start_s
                rows += 1
            children = psutil.Process().children(recursive=True)
            children_mb = sum(_peak_mb(child.pid) for child in children)
    figures = {"peak_mb": _peak_mb(os.getpid()), "children_mb": children_mb}
    print(json.dumps({"first_row_s": first_row_s, "rows": rows} | figures))


def _peak_mb(pid: int) -> float:
    """Return the largest resident memory that a process has had, MB."""
    line = PEAK_MEMORY_LINE.search(Path(f"/proc/{pid}/status").read_text())
    assert line is not None
    return int(line.group(1)) / 1024


def sweep_many(_: float, number: int = MANY_FOLDS) -> Section:
    """Measure a sweep of many empty folds, and a second run of it."""
    section = Section(name="sweep-many")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        first, run_s = _run(place, number)
        second, again_s = _run(place, number)
    section.add("rows", f"{first['rows']:.0f}", str(number), first["rows"] == number)
    section.add("rows of the second run", f"{second['rows']:.0f}", "0", second["rows"] == 0)
    section.add("all rows", f"{run_s:.0f} s, {1000 * run_s / number:.1f} ms a fold")
    figures: list[tuple[str, float, float, str]] = [
        ("first row after the workers", first["first_row_s"], MAX_FIRST_ROW_S, "s"),
        ("peak memory of the command", first["peak_mb"], MAX_COMMAND_MB, "MB"),
        ("second run, with nothing to do", again_s, MAX_SECOND_RUN_S, "s"),
        ("peak memory of the second run", second["peak_mb"], MAX_COMMAND_MB, "MB"),
    ]
    for name, value, bar, unit in figures:
        section.add(name, f"{value:.1f} {unit}", f"≤ {bar:g} {unit}", value <= bar)
    section.add(f"peak memory of its {WORKERS} workers", f"{first['children_mb']:.0f} MB")
    return section


def _run(place: str, number: int) -> tuple[dict[str, float], float]:
    """Return what a run of the command prints, and its wall time, s."""
    start_s = time.monotonic()
    command = [sys.executable, "-m", "bench.sweeps.many", place, str(number)]
    output = subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout
    return json.loads(output.splitlines()[-1]), time.monotonic() - start_s


if __name__ == "__main__":
    main()
