"""Runs of cases on any executor: one row of each, whatever happens to the executor."""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from foldback.planner.sweeps.case import Case, Outcome, Row
from foldback.planner.sweeps.run import run_cases
from tests.case import case
from tests.planner.sweeps import tasks


def cases(number: int, cases_taken: list[int] | None = None) -> Iterator[Case]:
    for index in range(number):
        if cases_taken is not None:
            cases_taken.append(index)
        yield Case(key=str(index), columns={"index": index}, task=tasks.empty)


def test_executors_give_a_row_of_each_case() -> None:
    spawn = get_context("spawn")
    for executor in (ThreadPoolExecutor(2), ProcessPoolExecutor(1, mp_context=spawn)):
        with case(type(executor).__name__), executor:
            written: list[Row] = []
            rows = list(run_cases(cases(5), written.append, executor, at_once=3))
            assert rows == written
            assert sorted(str(row["key"]) for row in rows) == ["0", "1", "2", "3", "4"]


class Immediate(Executor):
    """Executor that computes at once; ``trouble`` may give another result."""

    def __init__(self, files: Mapping[str, bytes] | None = None, **trouble: BaseException) -> None:
        self.submitted: list[str] = []
        self._files = {"a/plan": b"1"} if files is None else {**files}
        self._trouble = trouble

    def submit(self, fn: Any, case: Case, /) -> Future[Any]:  # pyright: ignore[reportIncompatibleMethodOverride]
        self.submitted.append(case.key)
        future: Future[Any] = Future()
        trouble = self._trouble.pop(f"case_{case.key}", None)
        if trouble is None:
            files = self._files if case.files_dir else {}
            future.set_result(Outcome(row={"key": case.key, "verdict": "computed"}, files=files))
        elif isinstance(trouble, KeyboardInterrupt):
            future.cancel()
        else:
            future.set_exception(trouble)
        return future


def test_cases_are_taken_when_there_is_room() -> None:
    cases_taken: list[int] = []
    written: list[Row] = []
    rows = run_cases(cases(1000, cases_taken), written.append, Immediate(), at_once=lambda: 4)
    assert next(rows) == written[0]
    assert cases_taken == [0, 1, 2, 3]
    rows.close()
    assert len(written) == 1


def test_case_that_the_executor_gives_up_is_lost() -> None:
    executor = Immediate(case_1=ConnectionError("its machines have ended"))
    verdicts = {
        row["key"]: row["verdict"] for row in run_cases(cases(3), [].append, executor, at_once=2)
    }
    assert verdicts == {"0": "computed", "1": "lost", "2": "computed"}


def test_case_that_the_executor_cancels_is_handed_out_again() -> None:
    executor = Immediate(case_1=KeyboardInterrupt())
    rows = list(run_cases(cases(3), [].append, executor, at_once=2))
    assert sorted(str(row["key"]) for row in rows) == ["0", "1", "2"]
    assert executor.submitted.count("1") == 2


def test_cases_follow_from_rows() -> None:
    def next_case(case: Case) -> Case | None:
        return Case(key=f"{case.key}b", columns={}, task=case.task) if case.key == "1" else None

    rows = list(run_cases(cases(3), [].append, Immediate(), at_once=1, next_case=next_case))
    assert [row["key"] for row in rows] == ["0", "1", "1b", "2"]


def test_files_are_stored_before_the_row(tmp_path: Path) -> None:
    storing_case = Case(key="1", columns={}, task=tasks.empty, files_dir=tmp_path / "plans" / "1")
    stored: list[bytes] = []

    def add(row: Row) -> None:
        stored.append((tmp_path / "plans" / "1" / "a" / "plan").read_bytes())

    list(run_cases([storing_case], add, Immediate(), at_once=1))
    assert stored == [b"1"]


def test_files_of_an_earlier_outcome_go(tmp_path: Path) -> None:
    for name, has_files in (("with", True), ("without", False)):
        with case(name):
            plan = tmp_path / name / "1"
            plan.mkdir(parents=True)
            (plan / "older").write_bytes(b"0")
            repeated = Case(key="1", columns={}, task=tasks.empty, files_dir=plan)
            files = {"plan": b"1"} if has_files else {}
            executor = Immediate(files)
            list(run_cases([repeated], [].append, executor, at_once=1))
            names = sorted(path.name for path in plan.parent.rglob("*"))
            assert names == (["1", "plan"] if has_files else [])
