"""Figures of sweeps: processor time besides the folds, and rows of cases that cannot end well."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Final

import psutil

from bench.sections import Section
from bench.sweeps import tasks
from foldback.planner.sweeps.case import Case, Limits, Row, Task
from foldback.planner.sweeps.executors import Place, executor_on
from foldback.planner.sweeps.run import run_cases

WORKERS: Final = 2
"""Number of Dask's workers."""
EMPTY_FOLDS: Final = 1000
"""Number of empty folds of which the processor time is measured."""
MAX_OVERHEAD_MS: Final = 20.0
"""Largest processor time of a fold besides its computation, ms."""


def sweeps(_: float) -> Section:
    """Measure processor time besides the folds, and the rows of cases that cannot end well."""
    section = Section(name="sweeps")
    start_s = time.monotonic()
    with executor_on(Place(workers=WORKERS)) as executor:
        section.add(f"start of Dask with {WORKERS} workers", f"{time.monotonic() - start_s:.1f} s")
        list(run_cases(_cases(2 * WORKERS, tasks.fold), _drop, executor, at_once=2 * WORKERS))
        before_s = _processor_s()
        rows = list(
            run_cases(_cases(EMPTY_FOLDS, tasks.empty), _drop, executor, at_once=executor.at_once)
        )
        overhead_ms = 1000 * (_processor_s() - before_s) / EMPTY_FOLDS
        child_ms = 1000 * sum(float(row["cpu_s"] or 0.0) for row in rows) / EMPTY_FOLDS
        section.add(
            "processor time of an empty fold, with Dask, its process and its row",
            f"{overhead_ms:.1f} ms",
            f"≤ {MAX_OVERHEAD_MS:.0f} ms",
            overhead_ms <= MAX_OVERHEAD_MS,
        )
        section.add("… of which its own process", f"{child_ms:.1f} ms")
        for task, limits, verdict in (
            (tasks.crash, Limits(), "crashed (SIGSEGV)"),
            (tasks.hang, Limits(wall_s=1.0), "time limit"),
            (tasks.take_memory, Limits(memory_bytes=2**29), "memory limit"),
        ):
            hostile = Case(key="1", columns={}, task=task, limits=limits)
            (row,) = run_cases([hostile], _drop, executor, at_once=1)
            section.add(
                f"row of {task.__name__.replace('_', ' ')}",
                str(row["verdict"]),
                verdict,
                row["verdict"] == verdict,
            )
    return section


def _cases(number: int, task: Task) -> Iterator[Case]:
    for index in range(number):
        yield Case(key=f"{task.__name__}-{index}", columns={}, task=task)


def _drop(row: Row) -> None:
    del row


def _processor_s() -> float:
    """Return the processor time of this process and all below it, those that ended as well, s."""
    command = psutil.Process()
    times = [process.cpu_times() for process in (command, *command.children(recursive=True))]
    return sum(t.user + t.system + t.children_user + t.children_system for t in times)
