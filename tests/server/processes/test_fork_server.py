"""Fork server: its children, their independence, and its end."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil
import pytest

from foldback.planner.progress import COMPILING
from foldback.server.processes import children, fork_server
from foldback.server.processes.children import LOST, ChildError
from foldback.server.processes.fork_server import ForkServer, Kind
from tests.refusal import refused
from tests.server.processes.test_children import make_child, upload_in, without_libraries
from tests.server.service_process import TIMEOUT_S, wait_until
from tests.server.service_thread import FORKS

pytestmark = pytest.mark.processes

RESULT = {"name": "snake", "module": "cube", "modules": 16}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    return upload_in(tmp_path)


def make_server(directory: Path, extra: str = "", *, warm: bool = False) -> ForkServer:
    """Return a server whose children compute nothing, and that first runs more code."""
    directory.mkdir()
    return ForkServer(["stages"], warm=warm, environment=without_libraries(directory, extra))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    with closing(make_server(tmp_path_factory.mktemp("forks") / "code")) as server:
        yield server


def pid_of(server: ForkServer) -> int:
    assert server.pid is not None
    return server.pid


def test_children_of_one_server_are_processes_of_their_own(directory: Path) -> None:
    with make_child(fork_server=FORKS) as first, make_child(fork_server=FORKS) as second:
        for child in (first, second):
            assert child.call("check", directory, wall_s=60) == RESULT
            process, pid = psutil.Process(child.pid), child.pid
            assert process.cmdline()[0] == "foldback reader"
            assert (process.ppid(), os.getpgid(pid), os.getsid(pid)) == (pid_of(FORKS), pid, pid)
        pids = {first.pid, second.pid}
        assert len(pids) == 2
    assert not pids & {process.pid for process in psutil.Process(pid_of(FORKS)).children()}


def test_children_of_a_killed_fork_server_end_and_it_is_replaced(
    server: ForkServer, directory: Path
) -> None:
    assert not server.starting
    server.start()
    assert server.starting
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
        wait_until(lambda: not server.starting)  # another thread is notified of the start
        process, first = psutil.Process(child.pid), pid_of(server)
        os.kill(first, signal.SIGKILL)
        assert not psutil.wait_procs([process], timeout=TIMEOUT_S)[1]
        with refused(LOST, kind=ChildError):
            child.call("read", directory, wall_s=60)
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
    assert pid_of(server) != first


def test_hung_fork_server_is_replaced(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fork_server, "MAX_SILENCE_S", 0.5)
    monkeypatch.setattr(fork_server, "PING_INTERVAL_S", 0.1)
    monkeypatch.setattr(children, "KILL_S", 0.5)
    with make_child("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60)
        first = pid_of(server)
        os.kill(first, signal.SIGSTOP)
        with make_child("stages", fork_server=server) as waiting:
            with pytest.raises(ChildError, match="did not start") as late:
                waiting.call("read", directory, wall_s=60)
            assert late.value.temporary
    with make_child("stages", fork_server=server) as child:
        assert child.call("read", directory, wall_s=60) == {}
        assert pid_of(server) != first
        # A running child also ends while the server is stopped.
        os.kill(pid_of(server), signal.SIGSTOP)
        child.kill()
        assert not child.alive


def test_child_ended_before_it_was_forked_does_not_stay(
    server: ForkServer, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with make_child("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60)
        os.kill(pid_of(server), signal.SIGSTOP)
        monkeypatch.setattr(children, "MAX_START_S", 0.0)
        with make_child("stages", fork_server=server) as early:
            with pytest.raises(ChildError, match="did not start: it took too long"):
                early.call("read", directory, wall_s=60)
            assert not early.alive
            os.kill(pid_of(server), signal.SIGCONT)
        monkeypatch.undo()
        assert child.call("read", directory, wall_s=60) == {}
        # The late child ends at once, because its client is gone.
        with make_child("stages", fork_server=server) as after:
            after.call("read", directory, wall_s=60)
            expected, forking = {child.pid, after.pid}, psutil.Process(pid_of(server))
            wait_until(lambda: {process.pid for process in forking.children()} == expected)


def test_reason_why_a_fork_server_cannot_start_is_logged(
    tmp_path: Path, directory: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    without_stages = "sys.modules['foldback.planner.pipeline.stages'] = None\n"
    with closing(make_server(tmp_path / "code", without_stages)) as server:
        for _ in range(2):
            with make_child("stages", fork_server=server) as child:
                words = "did not start: an unexpected error"
                with refused("no-start", match=words, kind=ChildError):
                    child.call("read", directory, wall_s=60)
    assert "foldback.planner.pipeline.stages" in capfd.readouterr().err


def test_progress_of_compiling_is_passed_on(tmp_path: Path, directory: Path) -> None:
    server = make_server(
        tmp_path / "code",
        "import time\n"
        "from pathlib import Path\n"
        "def warm_up(tell, soon, directory):\n"
        "    tell(Progress(stage='read', fraction=0.25, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.25')!r}).exists(): time.sleep(0.01)\n"
        "    tell(Progress(stage='read', fraction=0.5, message=COMPILING))\n"
        f"    while not Path({str(tmp_path / '0.5')!r}).exists(): time.sleep(0.01)\n"
        "warming.warm_up = warm_up\n",
        warm=True,
    )
    events: list[tuple[str, float]] = []

    def tell(event: dict[str, Any]) -> None:
        events.append((event["message"], event["fraction"]))
        (tmp_path / str(event["fraction"])).touch()

    with closing(server), make_child("stages", fork_server=server) as child:
        child.call("read", directory, wall_s=60, on_progress=tell)
    assert events[:2] == [(COMPILING, 0.25), (COMPILING, 0.5)]


LATE = """
import os, subprocess
from foldback.planner.compilation import compiling
finding.warm_up_paths = lambda: os.mkdir({place!r})
reading.check = lambda _: {whole}
compiling.Compiling.has_reported = property(lambda self: True, lambda self, value: None)
def beside(part, directory):
    return subprocess.Popen(["sleep", "600" if part == "paths" else "0"])
compiling.beside = beside
"""


def test_previews_wait_for_their_kernels_and_paths_do_not(tmp_path: Path, directory: Path) -> None:
    """A confined process cannot store kernels, so that each preview would compile again."""
    loaded = tmp_path / "loaded"
    environment = without_libraries(tmp_path, LATE.format(place=str(loaded), whole=RESULT))
    kinds: tuple[Kind, ...] = ("reader", "preparer")
    with closing(ForkServer(kinds, warm=True, environment=environment)) as server:
        with make_child("reader", fork_server=server) as child:
            assert child.call("check", directory, wall_s=60) == RESULT
        with make_child("preparer", fork_server=server) as child:
            result = child.call("check", directory, wall_s=60, cancelled=lambda: True)
            assert result["status"] == "cancelled"
            assert not loaded.exists()
            compiling = psutil.Process(pid_of(server)).children()
            next(
                compiler for compiler in compiling if compiler.cmdline() == ["sleep", "600"]
            ).kill()
            assert child.call("check", directory, wall_s=60) == RESULT
        assert loaded.exists()


PARENT = """
import sys, time
from pathlib import Path
from foldback.server.processes.children import Child
from foldback.server.processes.fork_server import ForkServer
from foldback.server.processes.limits import ChildLimits
warm = sys.argv[3] == "compiling"
server = ForkServer(["stages"], warm=warm, environment={"PYTHONPATH": sys.argv[2]})
server.start()
if warm:
    print(server.pid, flush=True)
else:
    limits = ChildLimits(memory_bytes=2**30, cpu_s=60.0, warm=False)
    child = Child("stages", limits, fork_server=server)
    child.call("read", Path(sys.argv[1]), wall_s=60)
    print(child.pid, server.pid, flush=True)
time.sleep(600)
"""
COMPILE = """
def warm_up(tell, soon, directory):
    while True:
        pass
warming.warm_up = warm_up
"""


@pytest.mark.parametrize("busy", ["forking", "compiling"])
def test_fork_server_that_compiles_ends_when_its_parent_is_killed(
    tmp_path: Path, directory: Path, busy: str
) -> None:
    """One case has a server with forked children, which must end as well."""
    search = without_libraries(tmp_path, COMPILE if busy == "compiling" else "")["PYTHONPATH"]
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(directory), search, busy],
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        children = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        assert len(children) == (1 if busy == "compiling" else 2)
        parent.kill()
    alive = psutil.wait_procs(children, timeout=TIMEOUT_S)[1]
    for process in alive:
        process.kill()
    assert not alive
