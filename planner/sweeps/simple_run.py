"""Run of cases on an executor, without limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from itertools import islice

from foldback.planner.progress import never
from foldback.planner.sweeps.case import Case, Outcome, Row


def compute(case: Case) -> Outcome:
    """Compute a case."""
    outcome = case.task(never)
    if not isinstance(outcome, Outcome):
        outcome = Outcome(row=outcome)
    return Outcome(row={"key": case.key, **case.columns, **outcome.row}, files=outcome.files)


def run_cases(
    cases: Iterable[Case],
    add: Callable[[Row], None],
    executor: Executor,
    *,
    at_once: int,
    next_case: Callable[[Case, Row], Case | None],
) -> Iterator[Row]:
    """Compute cases; store each row, then yield it."""
    waiting = iter(cases)
    running = {executor.submit(compute, case): case for case in islice(waiting, at_once)}
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            case = running.pop(future)
            outcome = future.result()
            if case.keep:
                for name, data in outcome.files.items():
                    (case.keep / name).parent.mkdir(parents=True, exist_ok=True)
                    (case.keep / name).write_bytes(data)
            add(outcome.row)
            yield outcome.row
            more = [c for c in [next_case(case, outcome.row)] if c] or list(islice(waiting, 1))
            running |= {executor.submit(compute, c): c for c in more}
