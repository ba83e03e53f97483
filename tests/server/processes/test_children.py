"""Processes that compute: results, errors, limits, and their end with their parent."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import psutil
import pytest

from foldback.planner.pipeline import stages
from foldback.planner.progress import STAGES
from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.limits.concurrency_quota import Quota
from foldback.server.processes import child as child_process
from foldback.server.processes import children
from foldback.server.processes.children import EVENTS, Child, ChildError, Pool
from foldback.server.processes.fork_server import ForkServer, Kind
from foldback.server.processes.limits import ChildLimits
from tests.refusal import refused
from tests.server.service_process import SNAKE
from tests.server.service_thread import FORKS

CHECKOUT = Path(__file__).parents[3]
LIMITS = ChildLimits(memory_bytes=2**30, cpu_s=60.0)
pytestmark = pytest.mark.processes
WITHOUT_LIBRARIES = """
import sys, types
from contextlib import nullcontext

def stand_in(name, works="", **has):
    sys.modules[name] = types.ModuleType(name)
    vars(sys.modules[name]).update(dict.fromkeys(works.split(), lambda *_, **__: {}), **has)
    return sys.modules[name]

for name in (
    "mujoco scipy.interpolate scipy.ndimage scipy.optimize scipy.sparse.csgraph "
    "trimesh foldback.planner.pathfinding.filling_methods "
    "foldback.planner.pathfinding.shape_overlap foldback.planner.pipeline.prepare "
    "foldback.planner.shapes.decimation foldback.planner.table_paths.offers"
).split():
    stand_in(name)
staging = stand_in("foldback.planner.pipeline.stages", "run_stage")
reading = stand_in("foldback.server.processes.read_task", "check offers preview")
retiming = stand_in("foldback.server.processes.retime_task", "clearance motors retime")
"""
"""Code that runs before a child: it replaces the computation, and avoids the import time."""
RUN_UPLOAD = """
import _thread, os, threading, time
from contextlib import suppress

def fail(error=MemoryError()):
    raise error

def to_files(do):
    for n in range(3, 64):
        with suppress(OSError):
            do(n)

def run_stage(stage, place, **_):
    exec((place / "input").read_text(), globals())
    time.sleep(30)
    os._exit(3)

staging.run_stage = run_stage
"""
"""Code of a child that follows the instructions in its upload."""
ONE = {"at_once": 1, "at_once_per_visitor": 1, "total": 9, "per_visitor": 6}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    return upload_in(tmp_path)


def upload_in(directory: Path) -> Path:
    """Put an upload into a directory, as children get it."""
    (directory / "request.json").write_text(json.dumps({"filename": "snake.json"}))
    (directory / "input").write_text(json.dumps(SNAKE))
    return directory


@contextmanager
def make_child(
    kind: Kind = "reader", limits: ChildLimits = LIMITS, **extra: Any
) -> Iterator[Child]:
    """Yield a child; it is started directly unless there is a fork server."""
    child = Child(kind, limits, **extra)
    try:
        yield child
    finally:
        child.close()


@pytest.fixture
def child() -> Iterator[Child]:
    with make_child(fork_server=FORKS) as child:
        yield child


def test_stages_are_those_of_the_planner() -> None:
    assert tuple(stages.STAGES) == STAGES


def test_child_answers_repeatedly_until_it_hangs(child: Child, directory: Path) -> None:
    for _ in range(2):
        child_report = child.call("check", directory, wall_s=60)
        assert child_report == {
            "name": "snake",
            "module": "cube",
            "module_words": None,
            "modules": 16,
        }
    os.kill(child.pid, signal.SIGSTOP)
    with refused("time-limit", match="exceeded its limit", kind=ChildError):
        child.call("check", directory, wall_s=0.1)
    assert not child.alive
    with pytest.raises(ChildError, match="SIGKILL"):
        child.call("check", directory, wall_s=60)


def test_task_slowed_by_a_busy_machine_is_not_to_blame(child: Child, directory: Path) -> None:
    child.call("check", directory, wall_s=60)
    process = psutil.Process(child.pid)
    process.suspend()  # suspended for longer than its processor time limit
    threading.Timer(0.4, process.resume).start()
    assert child.call("check", directory, wall_s=0.2, busy_factor=300)["modules"] == 16
    process.suspend()
    with pytest.raises(ChildError, match="busy; try again") as slowed:
        child.call("check", directory, wall_s=0.02, busy_factor=2)
    assert (slowed.value.code, slowed.value.temporary, child.alive) == ("busy", True, False)


def test_bad_input_error_and_crash_are_distinguished(child: Child, directory: Path) -> None:
    (directory / "input").write_text("[[0,0,0],[0,0,2],[0,0,3]]")
    with refused("not-adjacent", "cells 0 and 1"):
        child.call("check", directory, wall_s=60)
    (directory / "request.json").unlink()
    with pytest.raises(ChildError, match=UNEXPECTED_WORDS):
        child.call("check", directory, wall_s=60)
    assert child.alive
    os.kill(child.pid, signal.SIGSEGV)
    with refused("crashed", match="SIGSEGV", kind=ChildError):
        child.call("check", directory, wall_s=60)


@pytest.mark.parametrize(("limit", "value"), [("MAX_START_S", 0.0), ("MAX_START_CPU_S", 0.1)])
def test_start_of_a_child_is_limited(
    directory: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: float
) -> None:
    monkeypatch.setattr(children, limit, value)
    started = pytest.raises(ChildError, match="did not start: it took too long")
    with make_child("stages") as child, started:
        child.call("check", directory, wall_s=60)


def run_first(place: Path, code: str) -> dict[str, str]:
    """Return the environment of a process of this checkout that first runs other code."""
    (place / "sitecustomize.py").write_text(code)
    return {"PYTHONPATH": f"{place}{os.pathsep}{CHECKOUT}"}


def without_libraries(directory: Path, extra: str = "") -> dict[str, str]:
    """Return the environment of a child that computes nothing."""
    return run_first(directory, WITHOUT_LIBRARIES + extra)


def test_stage_of_a_replaced_execution_does_not_run(directory: Path, tmp_path: Path) -> None:
    with make_child("stages", environment=without_libraries(tmp_path, "")) as child:
        answers = [child.call("read", directory, wall_s=60, epoch=n) for n in (9, 10, 9, 10)]
    assert [answer.get("status") for answer in answers] == [None, None, "cancelled", None]


def test_child_that_ignores_a_cancellation_is_ended(child: Child, directory: Path) -> None:
    child.call("check", directory, wall_s=60)
    os.kill(child.pid, signal.SIGSTOP)
    result = child.call("check", directory, wall_s=60, cancelled=lambda: True)
    assert (result["status"], child.alive) == ("cancelled", False)


def test_memory_of_a_child_is_limited(directory: Path) -> None:
    limits = ChildLimits(memory_bytes=2**24, cpu_s=60.0)
    with (
        make_child("reader", limits, fork_server=FORKS) as child,
        refused("memory-limit", match="16 MiB", kind=ChildError),
    ):
        child.call("check", directory, wall_s=60)


@pytest.fixture
def pool() -> Iterator[Pool]:
    with closing(Pool("reader", LIMITS, wall_s=60, fork_server=FORKS)) as pool:
        yield pool


def test_reader_that_died_or_hangs_is_replaced(directory: Path, pool: Pool) -> None:
    pool._quota = Quota("uploads", **ONE)
    assert pool.call("check", directory, visitor="a")["modules"] == 16
    (child,) = pool._idle
    os.kill(child.pid, signal.SIGKILL)
    child._process.wait()
    assert pool.call("check", directory, visitor="a")["modules"] == 16
    os.kill(pool._idle[0].pid, signal.SIGSTOP)
    pool._wall_s = 0.1
    with pytest.raises(ChildError, match="machine is too busy") as late:
        pool.call("check", directory, visitor="a")
    assert late.value.temporary
    pool._wall_s = 60
    assert pool.call("check", directory, visitor="a")["modules"] == 16


@pytest.fixture(scope="module")
def overrun(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    """Fork server whose children follow the instructions in an upload."""
    environment = without_libraries(tmp_path_factory.mktemp("code"), RUN_UPLOAD)
    with closing(ForkServer(["stages"], environment=environment)) as server:
        yield server


@pytest.mark.parametrize(
    ("does", "words"),
    [
        ("os.closerange(3, 64)", "was stopped"),
        ("to_files(lambda n: os.write(n, b'rubbish\\n'))", "was stopped"),
        ("""to_files(lambda n: os.write(n, b'{"event": "done"}\\n'))""", "was stopped"),
        (
            "to_files(lambda n: [os.write(n, bytes(2**16)) for _ in range(2**10)])",
            "was stopped",
        ),
        ("threading.Thread(target=fail).start()", "1024 MiB"),
        ("_thread.start_new_thread(fail, ())", "1024 MiB"),
        ('fail(RuntimeError("can\'t start new thread"))', "1024 MiB"),
    ],
)
def test_child_that_closes_its_output_or_sends_rubbish_is_ended(
    directory: Path, overrun: ForkServer, does: str, words: str
) -> None:
    """One of the cases is a thread without memory."""
    (directory / "input").write_text(does)
    with make_child("stages", fork_server=overrun) as child:
        with pytest.raises(ChildError, match=words) as ended:
            child.call("read", directory, wall_s=60)
        assert (ended.value.code == "memory-limit") == ("MiB" in words)
        assert "MiB" in words or not child.alive


def test_child_that_reports_endlessly_has_to_wait(directory: Path, overrun: ForkServer) -> None:
    event = {"event": "progress", **dict.fromkeys(EVENTS["progress"], 0)}
    line = json.dumps(event).encode() + b"\n"
    endless = f"[os.write(n, {line!r}) for _ in range(10**6)]"
    (directory / "input").write_text(f"to_files(lambda n: {endless})")
    with make_child("stages", fork_server=overrun) as child:

        def note_full_queue(_: object) -> None:
            # blocks, so that the queue fills even if the child is slow
            while not child._events.full():
                time.sleep(0.01)
            raise InterruptedError

        with pytest.raises(InterruptedError):
            child.call("read", directory, wall_s=60, on_progress=note_full_queue)
    assert not child.alive


def test_failure_in_the_parent_leaves_no_child(directory: Path, pool: Pool) -> None:
    def fail_once() -> bool:
        raise RuntimeError("the gate is gone")

    pool.call("check", directory)
    (child,) = pool._children._all
    os.kill(child.pid, signal.SIGSTOP)
    with pytest.raises(RuntimeError, match="gate"):
        pool.call("check", directory, cancelled=fail_once)
    assert not child.alive and not pool._children._all


def test_slow_upload_of_one_visitor_does_not_delay_others(directory: Path, pool: Pool) -> None:
    pool._quota = Quota("uploads", **{**ONE, "at_once": 2})
    pool.call("check", directory, visitor="a")
    (child,) = pool._idle
    os.kill(child.pid, signal.SIGSTOP)
    with ThreadPoolExecutor(2) as threads:
        slow = threads.submit(pool.call, "check", directory, visitor="a")
        second = threads.submit(pool.call, "check", directory, visitor="a")
        assert pool.call("check", directory, visitor="b")["modules"] == 16
        assert not (slow.done() or second.done())
        os.kill(child.pid, signal.SIGCONT)
        assert (slow.result()["modules"], second.result()["modules"]) == (16, 16)


def test_child_ends_with_its_parent(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "foldback.server.processes.child", "stages"]
    with subprocess.Popen(
        [*command, json.dumps(asdict(LIMITS))],
        env={**os.environ, **without_libraries(tmp_path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as child:
        assert json.loads(child.stdout.readline())["event"] == "ready"
        child.stdin.close()
        assert child.wait(60) == 1


def test_unexpected_error_of_a_task_reaches_no_visitor(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its text may name files and code, and quote the input."""

    def fail(*_: object) -> dict[str, Any]:
        raise ValueError("array is too big; see /data/secret")

    sink = MagicMock()
    request = child_process.Request("preview", tmp_path)
    child_process._answer(sink, fail, request, 2**30)
    sink.tell.assert_called_once_with("problem", code="internal", detail=UNEXPECTED_WORDS)
    assert "/data/secret" in capfd.readouterr().err
