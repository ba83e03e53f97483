"""Run of cases: a window of cases on an executor, and a row of each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from pathlib import Path
from queue import SimpleQueue
from shutil import rmtree
from typing import Final

from foldback.planner.sweeps.case import LOST, Case, Outcome, Row
from foldback.planner.sweeps.limited_process import run_limited

CASES_PER_WORKER: Final = 4
"""Number of cases that are handed out for each worker: enough that none waits for the command."""


def run_cases(
    cases: Iterable[Case],
    add: Callable[[Row], None],
    executor: Executor,
    *,
    at_once: int | Callable[[], int],
    next_case: Callable[[Case], Case | None] = lambda _case: None,
) -> Generator[Row]:
    """Compute cases on an executor; yield their rows in the order in which they end.

    Cases are taken when there is room for them, so there may be any number. When the generator is
    closed, cases that are not finished are cancelled.

    Args:
        cases: The cases.
        add: Writes a row. It is called before the row is yielded.
        executor: Computes the cases. One that it cancels by itself is handed out again.
        at_once: Number of cases that are handed out at a time, ``CASES_PER_WORKER`` for each
            worker; or a function that returns it, as workers come and go.
        next_case: Returns the case that is added after the row of a case; None for none.

    Raises:
        BrokenExecutor: If the executor has ended, or its workers have another planner.
    """
    pending = iter(cases)
    following: deque[Case] = deque()
    running: dict[Future[Outcome], Case] = {}
    ended: SimpleQueue[Future[Outcome]] = SimpleQueue()

    def hand_out(case: Case) -> None:
        future = executor.submit(run_limited, case)
        running[future] = case
        future.add_done_callback(ended.put)

    try:
        while True:
            room = (at_once() if callable(at_once) else at_once) - len(running)
            for _ in range(room):
                case = following.popleft() if following else next(pending, None)
                if case is None:
                    break
                hand_out(case)
            if not running:
                return
            future = ended.get()
            case = running.pop(future)
            row = _row_of(case, future)
            if row is None:
                hand_out(case)
                continue
            add(row)
            if (addition := next_case(case)) is not None:
                following.append(addition)
            yield row
    finally:
        for future in running:
            future.cancel()


def _row_of(case: Case, future: Future[Outcome]) -> Row | None:
    """Return the row of a case, and store its files; return None if it was cancelled."""
    try:
        outcome = future.result()
    except CancelledError:
        return None
    except BrokenExecutor:
        raise
    except Exception as error:
        row: Row = {"verdict": LOST, "error": f"{type(error).__name__}: {error}"}
        return {"key": case.key, **case.columns, **row}
    if case.files_dir is not None:
        _replace_files(case.files_dir, outcome.files)
    return outcome.row


def _replace_files(directory: Path, files: Mapping[str, bytes]) -> None:
    """Replace a directory, which has all files or is not there, by one of these files."""
    growing = directory.with_name(f".{directory.name}")
    if growing.exists():  # of a command that was killed
        rmtree(growing)
    for name, data in files.items():
        path = growing / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    if directory.exists():
        rmtree(directory)
    if files:
        growing.rename(directory)
