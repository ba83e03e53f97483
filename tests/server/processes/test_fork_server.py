"""The process that forks children: what it is for, and how it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil
import pytest

from planner.progress import COMPILING
from server.processes import children
from server.processes.children import LOST, ChildError
from server.processes.fork_server import ForkServer, Kind
from tests.server.here import FORKS
from tests.server.processes.test_children import WITHOUT_LIBRARIES, made, upload_in
from tests.server.service import PATIENCE_S

pytestmark = pytest.mark.processes

WHOLE = {"name": "snake", "module": "cube", "modules": 16}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    return upload_in(tmp_path)


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServer]:
    with closing(ForkServer(["reader"], warm=False)) as server:
        yield server


def pid_of(server: ForkServer) -> int:
    assert server.pid is not None
    return server.pid


def spoiled(
    place: Path, code: str, *, kinds: Sequence[Kind] = ("stages",), warm: bool = False
) -> ForkServer:
    """One that runs code before anything else."""
    place.mkdir()
    (place / "sitecustomize.py").write_text(code)
    return ForkServer(kinds, warm=warm, environment={"PYTHONPATH": before_others(place)})


def before_others(place: Path) -> str:
    """Return a search path for modules that begins with a directory."""
    return os.pathsep.join([str(place), *filter(None, [os.environ.get("PYTHONPATH")])])


def test_fork_server_is_starting_until_it_can_fork(server: ForkServer, directory: Path) -> None:
    assert not server.starting
    server.start()
    assert server.starting
    with made(fork_server=server) as child:
        assert child.call("check", directory, wall_s=60) == WHOLE
    assert not server.starting


def test_children_of_one_server_are_processes_of_their_own(directory: Path) -> None:
    with made(fork_server=FORKS) as one, made(fork_server=FORKS) as other:
        for child in (one, other):
            assert child.call("check", directory, wall_s=60) == WHOLE
            process, pid = psutil.Process(child.pid), child.pid
            assert process.cmdline()[0] == "foldback reader"
            assert (process.ppid(), os.getpgid(pid), os.getsid(pid)) == (pid_of(FORKS), pid, pid)
        pids = {one.pid, other.pid}
        assert len(pids) == 2
    assert not pids & {each.pid for each in psutil.Process(pid_of(FORKS)).children()}


def test_killed_fork_server_takes_its_children_along_and_is_replaced(
    server: ForkServer, directory: Path
) -> None:
    with made(fork_server=server) as child:
        child.call("check", directory, wall_s=60)
        process, first = psutil.Process(child.pid), pid_of(server)
        os.kill(first, signal.SIGKILL)
        assert not psutil.wait_procs([process], timeout=PATIENCE_S)[1]
        with pytest.raises(ChildError) as ended:
            child.call("check", directory, wall_s=60)
        assert ended.value.code == LOST
    with made(fork_server=server) as child:
        assert child.call("check", directory, wall_s=60) == WHOLE
    assert pid_of(server) != first


def test_child_ended_before_it_was_forked_does_not_stay(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with made(fork_server=server) as child:
        child.call("check", directory, wall_s=60)
        os.kill(pid_of(server), signal.SIGSTOP)
        monkeypatch.setattr(children, "MAX_START_S", 0.0)
        with made(fork_server=server) as early:
            with pytest.raises(ChildError, match="did not start: took too long"):
                early.call("check", directory, wall_s=60)
            assert not early.alive
            os.kill(pid_of(server), signal.SIGCONT)
        monkeypatch.undo()
        assert child.call("check", directory, wall_s=60) == WHOLE
        # It is forked in its turn, and finds that nobody is there.
        with made(fork_server=server) as after:
            after.call("check", directory, wall_s=60)
            deadline = time.monotonic() + PATIENCE_S
            wanted = {child.pid, after.pid}
            while {one.pid for one in psutil.Process(pid_of(server)).children()} != wanted:
                assert time.monotonic() < deadline
                time.sleep(0.01)


def test_reason_why_a_fork_server_cannot_start_is_told(tmp_path: Path, directory: Path) -> None:
    code = "import sys\nsys.modules['planner.pipeline.stages'] = None\n"
    with closing(spoiled(tmp_path / "code", code)) as server:
        for _ in range(2):
            with made("stages", fork_server=server) as child:
                told = "did not start: .*planner.pipeline.stages"
                with pytest.raises(ChildError, match=told) as refused:
                    child.call("read", directory, wall_s=60)
                assert refused.value.code == "no-start"


def test_progress_of_compiling_is_passed_on(tmp_path: Path, directory: Path) -> None:
    server = spoiled(
        tmp_path / "code",
        f"{WITHOUT_LIBRARIES}import time\n"
        "from pathlib import Path\n"
        "it = stand_in('planner.pipeline.warm_up')\n"
        "def warm_up(tell, soon, directory):\n"
        "    tell(Progress(stage='read', fraction=0.25, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.25')!r}).exists(): time.sleep(0.01)\n"
        "    tell(Progress(stage='read', fraction=0.5, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.5')!r}).exists(): time.sleep(0.01)\n"
        "it.warm_up = warm_up\n",
        warm=True,
    )
    told: list[tuple[str, float]] = []

    def tell(event: dict[str, Any]) -> None:
        told.append((event["message"], event["fraction"]))
        (tmp_path / str(event["fraction"])).touch()

    with closing(server), made("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60, on_progress=tell)
    assert told[:2] == [(COMPILING, 0.25), (COMPILING, 0.5)]


LATE = """
import os, subprocess, sys
from planner.pipeline import compiling
it = sys.modules["planner.pipeline.warm_up_paths"] = type(sys)("warm_up_paths")
it.warm_up_paths = lambda: os.mkdir({place!r})
compiling.Compiling.told = property(lambda self: True, lambda self, value: None)
def beside(part, directory):
    return subprocess.Popen(["sleep", "600" if part == "paths" else "0"])
compiling.beside = beside
"""


def test_previews_wait_for_their_kernels_and_paths_do_not(tmp_path: Path, directory: Path) -> None:
    """A confined process cannot store what it compiles, so that each preview would repeat it."""
    loaded = tmp_path / "loaded"
    code = LATE.format(place=str(loaded))
    kinds: tuple[Kind, ...] = ("reader", "preparer")
    with closing(spoiled(tmp_path / "code", code, kinds=kinds, warm=True)) as server:
        with made("reader", fork_server=server) as child:
            assert child.call("check", directory, wall_s=60) == WHOLE
        with made("preparer", fork_server=server) as child:
            left = child.call("check", directory, wall_s=60, cancelled=lambda: True)
            assert left["status"] == "cancelled"
            assert not loaded.exists()
            compiling = psutil.Process(pid_of(server)).children()
            next(one for one in compiling if one.cmdline() == ["sleep", "600"]).kill()
            assert child.call("check", directory, wall_s=60) == WHOLE
        assert loaded.exists()


PARENT = """
import json, sys, time
from pathlib import Path
from server.processes.children import Child, LOST
from server.processes.fork_server import ForkServer, Kind
from server.processes.limits import ChildLimits
server = ForkServer(["reader"], warm=False)
limits = ChildLimits(memory_bytes=2**30, cpu_s=60.0, warm=False)
child = Child("reader", limits, fork_server=server)
child.call("check", Path(sys.argv[1]), wall_s=60)
print(child.pid, server.pid, flush=True)
time.sleep(600)
"""


def test_fork_server_and_its_children_end_with_their_parent(directory: Path) -> None:
    killed_parent(PARENT, str(directory))


def killed_parent(code: str, argument: str) -> None:
    """Kill a program that has told the ids of its processes: they end, too."""
    with subprocess.Popen(
        [sys.executable, "-c", code, argument], stdout=subprocess.PIPE, text=True
    ) as parent:
        theirs = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        assert theirs
        parent.kill()
    alive = psutil.wait_procs(theirs, timeout=PATIENCE_S)[1]
    for process in alive:
        process.kill()
    assert not alive


COMPILES = f"""{WITHOUT_LIBRARIES}
it = stand_in('planner.pipeline.warm_up')
def warm_up(tell, soon, directory):
    while True:
        pass
it.warm_up = warm_up
"""
STARTS = """
import os, signal, sys, time
from server.processes.fork_server import ForkServer, Kind
server = ForkServer(["stages"], warm=True, environment={"PYTHONPATH": sys.argv[1]})
server.start()
print(server.pid, flush=True)
time.sleep(600)
"""


def test_fork_server_that_compiles_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(COMPILES)
    killed_parent(STARTS, before_others(tmp_path))
