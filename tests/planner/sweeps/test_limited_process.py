"""Processes of cases: whatever happens in them is a row, and they end with their worker."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil

from foldback.planner.sweeps.case import Case, Limits, Outcome, Task
from foldback.planner.sweeps.case_forker import CPU_GRACE_S
from foldback.planner.sweeps.limited_process import run_limited
from tests.case import case
from tests.planner.sweeps import tasks
from tests.server.service_process import wait_until


def outcome_of(task: Task, **limits: float) -> Outcome:
    columns = {"shape": "a wrench", "verdict": None}
    return run_limited(Case(key="1", columns=columns, task=task, limits=Limits(**limits)))


def test_whatever_happens_in_a_case_is_a_row() -> None:
    for task, limits, verdict in (
        (tasks.empty, {}, "empty"),
        (tasks.fail, {}, "error"),
        (tasks.end_program, {}, "error"),
        (tasks.return_an_array, {}, "error"),
        (lambda cancelled: {}, {}, "error"),  # cannot be sent to another process
        (tasks.crash, {}, "crashed (SIGSEGV)"),
        (tasks.end_process, {}, "crashed (exit status 7)"),
        (tasks.end_process_well, {}, "crashed (exit status 0)"),
        (tasks.hang, {"wall_s": 0.2}, "time limit"),
        (tasks.take_memory, {"memory_bytes": 2**28}, "memory limit"),
        (tasks.spin, {"cpu_s": 0.1}, "ended by itself"),
        (tasks.start_program, {}, "started"),
    ):
        with case(verdict):
            row = outcome_of(task, **limits).row
            assert (row["verdict"], row["key"], row["shape"]) == (verdict, "1", "a wrench")
            assert "host" in row and "started_at" in row and "wall_s" in row


def test_row_of_an_error_says_what_happened() -> None:
    assert outcome_of(tasks.fail).row["error"] == "ValueError: got a fold, expected none"
    assert "column 'steps'" in str(outcome_of(tasks.return_an_array).row["error"])


def test_case_that_does_not_look_at_its_limit_of_processor_time_ends() -> None:
    cpu_s = 0.5 * (1 - CPU_GRACE_S)  # is killed after a second
    assert outcome_of(tasks.ignore_limit, cpu_s=cpu_s).row["verdict"] == "time limit"


def test_temporary_files_of_a_case_are_removed() -> None:
    places = [outcome_of(tasks.write_temporary).files["place"] for _ in range(2)]
    assert len(set(places)) == 2
    for place in places:
        assert not Path(place.decode()).parent.exists()


def test_modules_of_a_case_are_loaded_for_the_next_one() -> None:
    outcome_of(tasks.load_a_module)
    assert outcome_of(tasks.load_a_module).row["loaded"]


def test_case_ends_with_its_worker() -> None:
    """The case hangs in native code, so that only the kernel can end it."""
    program = (
        "from tests.planner.sweeps.test_limited_process import outcome_of, tasks; "
        "outcome_of(tasks.hang)"
    )
    worker = subprocess.Popen([sys.executable, "-c", program])
    about = psutil.Process(worker.pid)
    wait_until(lambda: len(about.children(recursive=True)) == 2)
    started = about.children(recursive=True)
    worker.kill()
    worker.wait()
    assert psutil.wait_procs(started, timeout=20)[1] == []


def test_case_whose_forker_was_killed_is_computed_again(tmp_path: Path) -> None:
    witness = tmp_path / "starts"
    row = outcome_of(tasks.KillAncestorOnce(witness, 1)).row
    assert row["verdict"] == "computed"
    assert len(witness.read_text().splitlines()) == 2
    for pid in witness.read_text().split():
        wait_until(lambda pid=pid: not psutil.pid_exists(int(pid)))


def test_cases_survive_forkers_that_were_killed_while_they_waited() -> None:
    with ThreadPoolExecutor(3) as pool:  # three forkers wait for cases afterwards
        cases = [Case(key=str(number), columns={}, task=tasks.empty) for number in range(3)]
        list(pool.map(run_limited, cases))
    for process in psutil.Process().children():
        if "case_forker" in " ".join(process.cmdline()):
            process.kill()
    assert outcome_of(tasks.empty).row["verdict"] == "empty"


def test_case_that_nobody_waits_for_ends() -> None:
    unwanted = Case(key="1", columns={}, task=tasks.hang)
    assert run_limited(unwanted, lambda: True).row["verdict"] == "not wanted"
